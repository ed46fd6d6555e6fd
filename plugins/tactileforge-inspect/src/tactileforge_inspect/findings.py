"""Findings of an inspection: totals, suspicious recordings, duplicates."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

#: Reasons in `InspectionFindings.looks`, which has the names of recordings as well.
_IN_LOOKS = frozenset({"colours_swapped", "on_its_side", "mirrored", "grey_pictures"})
#: Recordings that cannot be read, of which the summary tells why.
_NAMED = 3


@dataclass(frozen=True)
class Reason:
    """A reason to distrust a recording.

    Attributes:
        title: Problem, as a heading.
        why: Effect on training, and the measure.
        unit: Unit of the measured number.
        worst: 1 if larger numbers are worse, -1 if smaller ones are.
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
        value: Measured number, in the unit of the reason.
        words: Measured number in words.
        key: Key of the recording.
        split: Split of the recording.
        sensor: Sensor of the recording.
        order: Position among all recordings.
        picture: uint8 (h, w, 3), a small frame; None for a recording that was not decoded.
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
        recordings: Number of recordings.
        frames: Number of frames.
        seconds: Duration, s; 0 for a still.
        stills: Recordings of one frame.
        slowest: Lowest frame rate, Hz; NaN for stills alone.
        fastest: Highest frame rate, Hz; NaN for stills alone.
        carrying: Recordings with a label, by its name, ``background`` included.
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
        totals: Totals by split and sensor.
        looked: Number of decoded recordings.
        counts: Suspicious recordings by reason: of all for checks without pixels, else of the
            decoded ones.
        worst: Worst suspects by reason, worst first, a bounded number.
        duplicates: Keys of recordings with the same pixels, a group each.
        similar: Keys of two nearly identical recordings, and their difference, grey levels.
        repeated: Keys of more than one recording, a bounded number.
        unreadable: Line for each recording left out by the reader or with an undecodable frame.
        notes: Line for each kind of doubt about the set: notes of its reader, constant forces, a
            single class.
        looks: Line for each kind of odd resting pictures, with the names of the recordings.
        held_out: Lines about what is held out together.
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
    held_out: list[str] = field(default_factory=list)

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
        """Duration of all splits, s."""
        return sum(total.seconds for total in self.totals.values())

    def __str__(self) -> str:
        """Summary of a few lines for the command line."""
        sensors = sorted({sensor for _, sensor in self.totals})
        lines = [
            f"{self.recordings} recordings, {self.frames} frames, {self.seconds:.0f} s, of "
            f"{', '.join(sensors) or 'no sensor'}; {self.looked} looked at"
        ]
        for name, count in self.counts.items():
            if count and name not in _IN_LOOKS:
                worst = self.worst.get(name)
                of = f", the worst {worst[0].key}: {worst[0].words}" if worst else ""
                lines.append(f"{count} {name.replace('_', ' ')}{of}")
        lines += [f"held out: {line}" for line in self.held_out]
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
