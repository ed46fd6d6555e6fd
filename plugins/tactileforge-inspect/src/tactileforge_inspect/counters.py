"""Counters of recordings in constant memory."""

from __future__ import annotations

import heapq
import sqlite3
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tactileforge.contracts import ACTIONS, Recording
from tactileforge.data import labels_of
from tactileforge_inspect.findings import Total

#: Edges of the bins of durations, s: eight a decade.
DURATIONS = np.geomspace(0.01, 1e5, 57)
#: Bins on each side of 0, an even number: two of them become one.
_BINS = 24


class NameCounts:
    """Exact counts of names of several kinds, in a temporary database on disk."""

    def __init__(self) -> None:
        # an empty name is a private file, deleted on closing, with 2 MB of it in memory
        # (sqlite.org/inmemorydb.html, "Temporary Databases"). A million keys take 16 s of one core
        # and 2 MB; a `collections.Counter` takes 2 s and 203 MB, .6 GB for the keys of FoTa
        self._base = sqlite3.connect("", isolation_level=None)
        self._base.execute(
            "CREATE TABLE names (kind, name, count, PRIMARY KEY (kind, name)) WITHOUT ROWID"
        )

    def add(self, kind: str, name: str, count: int = 1) -> None:
        """Count a name."""
        self._base.execute(
            "INSERT INTO names VALUES (?, ?, ?) ON CONFLICT DO UPDATE "
            "SET count = count + excluded.count",
            (kind, name, count),
        )

    def top(self, kind: str, most: int) -> list[tuple[str, int]]:
        """Most frequent names with their counts."""
        query = "SELECT name, count FROM names WHERE kind = ? ORDER BY count DESC, name LIMIT ?"
        return [(str(name), int(count)) for name, count in self._base.execute(query, (kind, most))]

    def number(self, kind: str) -> tuple[int, int]:
        """Number of distinct names of a kind, and the sum of their counts."""
        query = "SELECT COUNT(*), COALESCE(SUM(count), 0) FROM names WHERE kind = ?"
        names, total = self._base.execute(query, (kind,)).fetchone()
        return int(names), int(total)


class Histogram:
    """Histogram of values around 0; its bins double in width for values beyond them.

    Args:
        reach: Initial end of the outermost bins.
    """

    def __init__(self, reach: float = 1.0) -> None:
        self.reach = reach
        self.counts = np.zeros(2 * _BINS, np.int64)

    @property
    def edges(self) -> NDArray[np.float64]:
        """Edges of the bins, float64 (bins + 1,)."""
        return np.linspace(-self.reach, self.reach, 2 * _BINS + 1)

    def add(self, values: NDArray[np.floating]) -> None:
        """Count the finite values."""
        values = values[np.isfinite(values)].astype(np.float64)
        if not len(values):
            return
        # by doubling, so that counts of old bins fall into new ones as a whole
        while np.abs(values).max() >= self.reach:
            self.counts = self.over(2 * self.reach)
            self.reach *= 2
        # after the bins have grown: a value beyond them would be lost
        self.counts += np.histogram(values, self.edges)[0]

    def over(self, reach: float) -> NDArray[np.int64]:
        """Counts in wider bins up to ``reach``, a power of 2 times the present reach."""
        counts = self.counts
        # two bins become one, exactly: the number of bins is even, and 0 is always an edge
        for _ in range(round(np.log2(reach / self.reach))):
            counts = np.pad(counts.reshape(-1, 2).sum(axis=1), _BINS // 2)
        return counts


@dataclass(frozen=True)
class SampledRecording:
    """Recording of a sample.

    Attributes:
        recording: The recording.
        split: Split of the recording.
        order: Position among all recordings.
    """

    recording: Recording
    split: str
    order: int


class RecordingSample:
    """Random sample of at most ``limit`` recordings, with a fair share for each sensor.

    Each recording draws a number, and the lowest stay: one pass is enough, and the number of
    recordings need not be known. The same recordings in the same order give the same sample.

    Args:
        limit: Size of the sample.
    """

    def __init__(self, limit: int) -> None:
        self.limit = limit
        self._random = np.random.default_rng(0)
        self._heaps: dict[str, list[tuple[float, int, SampledRecording]]] = {}

    def offer(self, sampled: SampledRecording) -> None:
        """Draw a number for a recording, and keep it if the number is low."""
        heap = self._heaps.setdefault(sampled.recording.sensor, [])
        # negative, as heapq is a min-heap: the first to go is the largest number drawn
        entry = (-float(self._random.random()), sampled.order, sampled)
        if len(heap) < self.limit:
            heapq.heappush(heap, entry)
        else:
            heapq.heappushpop(heap, entry)

    def drawn(self) -> list[SampledRecording]:
        """Sample in the order of the recordings."""
        heaps = sorted(self._heaps.values(), key=len)
        left, chosen = self.limit, list[SampledRecording]()
        for place, heap in enumerate(heaps):
            # small sensors first: what they leave is shared out among the larger ones
            share = min(len(heap), -(-left // (len(heaps) - place)))
            left -= share
            chosen += [sampled for *_, sampled in heapq.nlargest(share, heap)]
        return sorted(chosen, key=lambda sampled: sampled.order)


class Counters:
    """Counters over all recordings; decodes nothing."""

    def __init__(self) -> None:
        self.totals: dict[tuple[str, str], Total] = {}
        self.names = NameCounts()
        self.forces: dict[str, list[Histogram]] = {}
        self.durations = np.zeros(len(DURATIONS) - 1, np.int64)
        self.stills = 0

    def add(self, recording: Recording, split: str) -> None:
        """Count a recording."""
        total = self.totals.setdefault((split, recording.sensor), Total())
        total.recordings += 1
        total.frames += len(recording.frames)
        seconds = duration_of(recording)
        total.seconds += seconds
        if seconds > 0:
            rate = 1 / recording.period
            # fmin and fmax pass over the NaN of a sum without a rate yet
            total.slowest = float(np.fmin(total.slowest, rate))
            total.fastest = float(np.fmax(total.fastest, rate))
            place = np.searchsorted(DURATIONS, seconds, side="right") - 1
            self.durations[int(np.clip(place, 0, len(self.durations) - 1))] += 1
        else:
            self.stills += 1
            total.stills += 1
        for label in labels_of(recording):
            total.carrying[label] = total.carrying.get(label, 0) + 1
        if recording.no_contact is not None:
            total.carrying["background"] = total.carrying.get("background", 0) + 1
        # one name of three fields, taken apart again in `source_rows`
        self.names.add("source", f"{recording.source}\0{recording.licence}\0{recording.tier}")
        if recording.object is not None:
            self.names.add("object", recording.object)
        if recording.action is not None:
            for label, number in zip(*np.unique(recording.action, return_counts=True), strict=True):
                # a foreign data set may have numbers of its own
                name = ACTIONS[label] if 0 <= label < len(ACTIONS) else "unknown"
                self.names.add("action", name, int(number))
        if recording.force is not None:
            axes = self.forces.setdefault(recording.sensor, [Histogram() for _ in range(3)])
            for axis, values in zip(axes, recording.force.T, strict=True):
                axis.add(values)
        self.names.add("key", recording.key)


def duration_of(recording: Recording) -> float:
    """Duration from the first frame to the end of the last, s; 0 for a still or constant times."""
    times = recording.times
    if len(times) < 2:
        return 0.0
    step = float(np.median(np.diff(times)))
    return float(times[-1] - times[0] + step) if step > 0 else 0.0


def source_rows(names: NameCounts, most: int) -> Iterable[tuple[str, str, str, int]]:
    """Source, licence, tier and number of recordings, largest number first."""
    for line, count in names.top("source", most):
        source, licence, tier = line.split("\0")
        yield source, licence, tier, count
