"""Findings of an inspection: totals, suspicious recordings, duplicates."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

#: Reasons that `InspectionFindings.looks` tells, with the names.
_IN_LOOKS = frozenset({"colours_swapped", "on_its_side", "grey_pictures"})
#: Recordings that cannot be read, of which the summary tells why.
_NAMED = 3


@dataclass(frozen=True)
class Reason:
    """A reason to distrust a recording.

    Attributes:
        title: The problem, as a heading.
        why: Its effect on training, and the measure.
        unit: Of the measured number.
        worst: 1 where larger numbers are worse, -1 where smaller ones are.
    """

    title: str
    why: str
    unit: str = ""
    worst: int = 1


@dataclass(frozen=True)
class Suspect:
    """A suspicious recording.

    Attributes:
        reason: Name of the reason.
        value: The measured number, in the unit of the reason.
        words: The same in words.
        key: Key of the recording.
        split: Its split.
        sensor: Its sensor.
        order: Its place among all recordings.
        picture: uint8 (h, w, 3), a small frame of it; None where no frame was read.
    """

    reason: str
    value: float
    words: str
    key: str
    split: str
    sensor: str
    order: int
    picture: NDArray[np.uint8] | None = field(default=None, repr=False)


@dataclass
class Total:
    """Sums over the recordings of one sensor in one split.

    Attributes:
        recordings: Their number.
        frames: Their frames.
        seconds: Their time; a still lasts none.
        stills: Recordings of one frame.
        slowest: Lowest frame rate, Hz; NaN where all are stills.
        fastest: Highest frame rate, Hz.
        carrying: Recordings that carry a label, by its name; ``background`` is among them.
    """

    recordings: int = 0
    frames: int = 0
    seconds: float = 0.0
    stills: int = 0
    slowest: float = float("nan")
    fastest: float = float("nan")
    carrying: dict[str, int] = field(default_factory=dict)


@dataclass(frozen=True)
class InspectionFindings:
    """Findings in a data set.

    Attributes:
        totals: By split and sensor.
        looked: Recordings whose pixels were looked at.
        counts: Suspicious recordings by reason, of all where no pixel is needed to tell, else of
            those looked at.
        worst: The worst of them by reason, worst first, a bounded number.
        duplicates: Keys of recordings that show the same pixels, a group each.
        similar: Keys of two recordings that show nearly the same, and by how many grey levels
            they differ.
        repeated: Keys that more than one recording has, a bounded number.
        unreadable: One line for each recording that the reader left out, or that has a frame that
            cannot be decoded.
        notes: One line for each kind of doubt about the set: what its reader noticed, forces that
            never change, one class alone.
        looks: One line for each way in which resting pictures are odd; names the recordings.
    """

    totals: dict[tuple[str, str], Total]
    looked: int
    counts: dict[str, int]
    worst: dict[str, list[Suspect]]
    duplicates: list[tuple[str, ...]]
    similar: list[tuple[str, str, float]]
    repeated: list[str]
    unreadable: list[str]
    notes: list[str] = field(default_factory=list)
    looks: list[str] = field(default_factory=list)

    @property
    def recordings(self) -> int:
        """Recordings in all splits."""
        return sum(total.recordings for total in self.totals.values())

    @property
    def frames(self) -> int:
        """Frames in all splits."""
        return sum(total.frames for total in self.totals.values())

    @property
    def seconds(self) -> float:
        """Time in all splits, s."""
        return sum(total.seconds for total in self.totals.values())

    def _worst(self, reason: str) -> str:
        worst = self.worst.get(reason)
        return f", the worst {worst[0].key}: {worst[0].words}" if worst else ""

    def __str__(self) -> str:
        """A few lines for the command line."""
        sensors = sorted({sensor for _, sensor in self.totals})
        lines = [
            f"{self.recordings} recordings, {self.frames} frames, {self.seconds:.0f} s, of "
            f"{', '.join(sensors) or 'no sensor'}; {self.looked} looked at"
        ]
        lines += [
            f"{count} {name.replace('_', ' ')}{self._worst(name)}"
            for name, count in self.counts.items()
            if count and name not in _IN_LOOKS
        ]
        lines += self.looks
        counted = (
            ("recording", " cannot be read", self.unreadable),
            ("group", " of recordings with the same pixels", self.duplicates),
            ("pair", " of recordings that are nearly the same", self.similar),
            ("key", " of more than one recording", self.repeated),
        )
        for noun, words, entries in counted:
            if entries:
                lines.append(f"{len(entries)} {noun}{'s' * (len(entries) != 1)}{words}")
        lines += [f"  {line}" for line in self.unreadable[:_NAMED]]
        return "\n".join([*lines, *(f"note: {line}" for line in self.notes)])
