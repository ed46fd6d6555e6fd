"""Counts of a set of recordings, kept in indices and shown in reports."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from tactileforge.contracts import AXES, LABELS, Recording

#: Labels with a field of a recording, without force (it may lack axes).
_FIELDS = frozenset({"action", "object", "text", "image", "surface"})

#: Counted labels, and axes of force.
COUNTED = (*LABELS, *(f"force.{axis}" for axis in AXES))


def labels_of(recording: Recording) -> list[str]:
    """Labels of a recording, of `COUNTED`.

    A force of NaN in every frame does not count, nor does an action unknown in every frame.
    """
    there = [key for key in LABELS if key in _FIELDS and getattr(recording, key) is not None]
    acted = recording.action is not None and (recording.action >= 0).any()
    labels = [key for key in there if key != "action" or acted]
    if recording.force is None:
        return labels
    axes = [
        axis for axis, row in zip(AXES, recording.force.T, strict=True) if np.isfinite(row).any()
    ]
    return [*labels, *(["force"] if axes else []), *(f"force.{axis}" for axis in axes)]


def counted(labels: Mapping[str, int], label: str) -> str:
    """Format a count for a table; of forces by axis, if the axes differ."""
    count = labels.get(label, 0)
    axes = {axis: labels.get(f"{label}.{axis}", 0) for axis in AXES}
    partial = label == "force" and any(axes.values()) and set(axes.values()) != {count}
    alone = [axis for axis, n in axes.items() if n == count]
    rest = [n for axis, n in axes.items() if axis not in alone]
    by_axis = ", ".join(f"{axis} {n:,}" for axis, n in axes.items())
    if alone and not any(rest):
        by_axis = " and ".join(alone) + " alone"
    return f"{count:,} ({by_axis})" if partial else f"{count:,}" if count else "none"


@dataclass(frozen=True, order=True)
class RecordingKind:
    """Key of recordings counted together.

    Attributes:
        sensor: Name of the sensor.
        source: Source of the recordings.
        licence: Licence, see `contracts.Recording`.
        tier: Tier of tactile dynamics, 1 to 5.
    """

    sensor: str
    source: str
    licence: str
    tier: int


@dataclass
class Count:
    """Counts of one kind.

    Attributes:
        recordings: Number of recordings.
        frames: Number of frames.
        seconds: Duration of the frames without gaps, s; 0 for a still.
        labels: Recordings with each label of `COUNTED`, whole or in part.
    """

    recordings: int = 0
    frames: int = 0
    seconds: float = 0.0
    labels: Counter[str] = field(default_factory=Counter)


class Summary(dict[RecordingKind, Count]):
    """Counts of each kind of recording.

    Example:
        >>> Summary().recordings, Summary().sensors
        (0, [])
    """

    @classmethod
    def of(cls, recordings: Iterable[Recording]) -> Summary:
        """Count recordings; decodes nothing."""
        summary = cls()
        for recording in recordings:
            summary.add(recording)
        return summary

    def add(self, recording: Recording) -> None:
        """Count one more recording."""
        kind = RecordingKind(recording.sensor, recording.source, recording.licence, recording.tier)
        count = self.setdefault(kind, Count())
        count.recordings += 1
        count.frames += len(recording.frames)
        count.seconds += duration_seconds(recording)
        count.labels.update(labels_of(recording))

    def merge(self, other: Mapping[RecordingKind, Count]) -> None:
        """Add the counts of another summary."""
        for kind, theirs in other.items():
            count = self.setdefault(kind, Count())
            count.recordings += theirs.recordings
            count.frames += theirs.frames
            count.seconds += theirs.seconds
            count.labels.update(theirs.labels)

    def times(self, factor: float) -> Summary:
        """Counts of a part of the data, as an estimate of those of the whole.

        Args:
            factor: Size of the whole over that of the part.
        """
        return Summary(
            {
                kind: Count(
                    round(count.recordings * factor),
                    round(count.frames * factor),
                    count.seconds * factor,
                    Counter({label: round(n * factor) for label, n in count.labels.items()}),
                )
                for kind, count in self.items()
            }
        )

    @property
    def recordings(self) -> int:
        """Number of recordings of all kinds."""
        return sum(count.recordings for count in self.values())

    @property
    def frames(self) -> int:
        """Number of frames of all kinds."""
        return sum(count.frames for count in self.values())

    @property
    def seconds(self) -> float:
        """Duration of all kinds, s."""
        return sum(count.seconds for count in self.values())

    @property
    def sensors(self) -> list[str]:
        """Names of the sensors, sorted."""
        return sorted({kind.sensor for kind in self})

    @property
    def labels(self) -> frozenset[str]:
        """Labels of at least one recording."""
        present = {key for count in self.values() for key, n in count.labels.items() if n}
        return frozenset(present & set(LABELS))

    def to_json(self) -> list[dict[str, Any]]:
        """The summary as plain data; see `from_json`."""
        return [
            {
                "sensor": kind.sensor,
                "source": kind.source,
                "licence": kind.licence,
                "tier": kind.tier,
                "recordings": count.recordings,
                "frames": count.frames,
                "seconds": round(count.seconds, 6),
                "labels": {key: count.labels[key] for key in COUNTED if count.labels[key]},
            }
            for kind, count in sorted(self.items())
        ]

    @classmethod
    def from_json(cls, rows: Iterable[Mapping[str, Any]]) -> Summary:
        """Build a summary from plain data of `to_json`.

        Raises:
            KeyError: A row lacks a value.
            TypeError: A value is of the wrong type.
        """
        summary = cls()
        for row in rows:
            kind = RecordingKind(row["sensor"], row["source"], row["licence"], int(row["tier"]))
            labels = Counter({key: int(n) for key, n in row["labels"].items() if key in COUNTED})
            count = Count(int(row["recordings"]), int(row["frames"]), float(row["seconds"]), labels)
            summary.merge({kind: count})
        return summary


def duration_seconds(recording: Recording) -> float:
    """Duration of the frames, s, without gaps between them; 0 for a still."""
    times = recording.times
    return float(len(times) * np.median(np.diff(times))) if len(times) > 1 else 0.0
