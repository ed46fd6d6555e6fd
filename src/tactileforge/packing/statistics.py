"""Statistics of packed recordings, additive over shards."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactileforge.contracts import ACTIONS, Recording
from tactileforge.data.shards.summary import duration_seconds

#: Edges of the bins of forces, N, the same for all shards so that counts add up; the outermost bins
#: also hold larger forces.
FORCE_EDGES = np.linspace(-20.0, 20.0, 81)
AXES = ("x", "y", "z")


#: Counts of what was read, and of what is missing.
COUNTS = ("read", "emptied", "damaged", "unmarked")


@dataclass(eq=False)
class PackStatistics:
    """Counts of a split, or of a part of one.

    Attributes:
        recordings: Packed recordings.
        frames: Packed frames.
        seconds: Duration of the recordings, s.
        bytes: Size of the shards.
        sensors: Frames of each sensor.
        actions: Frames of each action; ``unknown`` for a missing label.
        objects: Names of the touched objects.
        force: int64 (3, bins), frames by force along x, y and z, see `FORCE_EDGES`.
        read: Frames read.
        emptied: Recordings without a frame after the filter.
        damaged: Unreadable recordings, whole or in part.
        unmarked: Recordings without marker tracks, where these were asked for.
        skipped: Line for each unreadable recording or frame.
    """

    recordings: int = 0
    frames: int = 0
    seconds: float = 0.0
    bytes: int = 0
    sensors: Counter[str] = field(default_factory=Counter)
    actions: Counter[str] = field(default_factory=Counter)
    objects: set[str] = field(default_factory=set)
    force: NDArray[np.int64] = field(
        default_factory=lambda: np.zeros((len(AXES), len(FORCE_EDGES) - 1), np.int64)
    )
    read: int = 0
    emptied: int = 0
    damaged: int = 0
    unmarked: int = 0
    skipped: list[str] = field(default_factory=list)

    def add(self, recording: Recording) -> None:
        """Count a packed recording; decodes nothing."""
        count = len(recording.times)
        self.recordings += 1
        self.frames += count
        self.seconds += duration_seconds(recording)
        self.sensors[recording.sensor] += count
        if recording.object is not None:
            self.objects.add(recording.object)
        action = recording.action if recording.action is not None else np.full(count, -1)
        for label, number in zip(*np.unique(action, return_counts=True), strict=True):
            self.actions[ACTIONS[label] if label >= 0 else "unknown"] += int(number)
        if recording.force is not None:
            for i, along in enumerate(recording.force.T):
                inside = along[np.isfinite(along)].clip(FORCE_EDGES[0], FORCE_EDGES[-1])
                self.force[i] += np.histogram(inside, FORCE_EDGES)[0]

    def merge(self, other: PackStatistics) -> None:
        """Add the counts of another part."""
        for name in ("recordings", "frames", "seconds", "bytes", *COUNTS):
            setattr(self, name, getattr(self, name) + getattr(other, name))
        self.sensors.update(other.sensors)
        self.actions.update(other.actions)
        self.objects |= other.objects
        self.force += other.force
        self.skipped += other.skipped

    def to_json(self) -> dict[str, Any]:
        """The counts as plain data; see `from_json`."""
        return {
            "recordings": self.recordings,
            "frames": self.frames,
            "seconds": self.seconds,
            "bytes": self.bytes,
            "sensors": dict(sorted(self.sensors.items())),
            "actions": {name: self.actions[name] for name in (*ACTIONS, "unknown")},
            "objects": sorted(self.objects),
            "force": {axis: row.tolist() for axis, row in zip(AXES, self.force, strict=True)},
            "read": self.read,
            "emptied": self.emptied,
            "damaged": self.damaged,
            "unmarked": self.unmarked,
            "skipped": self.skipped,
        }

    def report(self) -> dict[str, Any]:
        """Counts for the index: with the edges of the bins, and the number of objects."""
        plain = self.to_json()
        plain["seconds"] = round(self.seconds, 6)
        plain["objects"] = len(self.objects)
        plain["force"]["edges"] = FORCE_EDGES.tolist()
        return plain

    @classmethod
    def from_json(cls, plain: Mapping[str, Any]) -> PackStatistics:
        """Build counts from plain data of `to_json`.

        Raises:
            KeyError: A value is missing.
        """
        force = np.array([plain["force"][axis] for axis in AXES], np.int64)
        return cls(
            **{
                **plain,
                "sensors": Counter(plain["sensors"]),
                "actions": Counter(plain["actions"]),
                "objects": set(plain["objects"]),
                "force": force,
            }
        )
