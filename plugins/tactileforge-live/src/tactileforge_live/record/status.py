"""Status line of a running recording."""

from __future__ import annotations

import shutil
import time
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, TextIO

from tactileforge.checks import Finding
from tactileforge.sensors import Status
from tactileforge_live.record.frame_queue import FrameQueue

if TYPE_CHECKING:
    from tactileforge_live.record.rig import Rig, RigSensor

#: Time between two lines, s: on a terminal, overwriting the previous line, and elsewhere.
_TERMINAL, _ELSEWHERE = 0.25, 5.0


@dataclass
class RecordSummary:
    """Totals of a recording.

    Attributes:
        takes: Number of takes with at least one segment.
        seconds: Total duration, s.
        frames: Number of frames of each sensor.
        dropped: Number of frames of each device dropped because of full queues.
        bytes: Size of the shards, bytes.
        reasons: Numbers of dropped frames of each device, by reason; ``late`` for full queues.
        findings: What the checks of streams have found, by device.
    """

    takes: int
    seconds: float
    frames: dict[str, int]
    dropped: dict[str, int]
    bytes: int
    reasons: dict[str, dict[str, int]] = field(default_factory=dict)
    findings: dict[str, list[Finding]] = field(default_factory=dict)


class RecordStatus(Status):
    """Status line of a recording, with the findings of its checks.

    Args:
        to: Text stream; None for standard error.
    """

    def __init__(self, to: TextIO | None = None) -> None:
        super().__init__(to)
        self._warned: set[tuple[str, str]] = set()

    def show(self, rig: Rig, take: int, seconds: float, summary: RecordSummary) -> None:
        """Writes the line if it is due."""
        now = time.monotonic()
        if now < self._next:
            return
        self._next = now + (_TERMINAL if self._is_terminal else _ELSEWHERE)
        for device in rig.all:
            # copied, as the sensor's thread adds to them
            for trouble, finding in list(device.checks.found.items()):
                if (device.name, trouble) not in self._warned:
                    self._warned.add((device.name, trouble))
                    self.end()
                    self.to.write(f"warning: {finding}\n")
        free = shutil.disk_usage(rig.options.out).free  # others may fill the disk, too
        parts = [
            f"take {take} {seconds:6.1f} s",
            *map(device_status, rig.all),
            f"saved {summary.seconds:.0f} s, {summary.bytes / 1e6:.1f} MB",
            f"disk {free / 1e9:.0f} GB",
        ]
        self._write(" | ".join(parts))


def device_status(device: RigSensor) -> str:
    """Status of one device: rate, waiting frames, lost frames."""
    capture, keeps = device.capture, device.keeps
    if capture.is_lost:
        return f"{device.name} LOST"
    words = [f"{device.name} {capture.fps:.1f} fps"]
    if isinstance(keeps, FrameQueue):
        words.append(f"queue {keeps.waiting}")
    words.append(f"dropped {keeps.dropped}")
    counts = capture.counts
    others = capture.drops() | {"stalled": counts.stalled, "reopened": counts.reopened}
    words += [f"{name} {count}" for name, count in others.items() if count]
    return " ".join(words)
