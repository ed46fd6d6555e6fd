"""Samplers of the clips of one source: all of them, or a moving window.

A small source is sampled as a whole. Of a large one, every reader (one worker of one rank) holds a
*window* of whole parts, takes clips from it in random order, and moves on; the order of the parts
is shuffled anew each pass.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tactileforge.contracts import Recording
from tactileforge.data.batches.clips import Clips
from tactileforge.data.batches.sources import Bad, Source
from tactileforge.errors import DataError

#: Consecutive windows without a single clip before reading gives up.
_MAX_EMPTY = 20


@dataclass(frozen=True)
class WorkerId:
    """One worker of one rank.

    Attributes:
        rank: Rank of the process.
        world: Number of processes.
        workers: Readers of each process.
    """

    rank: int = 0
    world: int = 1
    workers: int = 1


@dataclass(frozen=True)
class SourceDraw:
    """Clips of one source in a batch: the clips at hand, and the drawn rows in order."""

    clips: Clips
    rows: NDArray[np.int64]


class FullSource:
    """Sampler of a whole source: an epoch is a permutation of its clips.

    Args:
        clips: All clips of the source.
        count: Clips of the source in a batch.
        seed: Seed, unique within the run.
    """

    windowed = False

    def __init__(self, clips: Clips, count: int, seed: Sequence[int]) -> None:
        self.clips = clips
        self.count = count
        self.seed = tuple(seed)
        self._orders: dict[int, NDArray[np.int64]] = {}

    @property
    def size(self) -> float:
        """Number of clips."""
        return len(self.clips)

    def draw(self, number: int, reader: WorkerId, bad: Bad) -> SourceDraw:
        """Draws the clips of batch ``number`` for a reader's rank."""
        # ranks take consecutive slices of one endless series of permutations: no clip is drawn
        # twice in a pass, for any number of ranks, and a batch may span two passes
        first = (number * reader.world + reader.rank) * self.count
        passes, rows = divmod(np.arange(first, first + self.count), len(self.clips))
        for old in set(self._orders) - set(passes.tolist()):  # permutations are large: keep two
            del self._orders[old]
        for new in set(passes.tolist()) - set(self._orders):
            rng = np.random.default_rng([*self.seed, new])
            self._orders[new] = rng.permutation(len(self.clips))
        picked = [self._orders[int(p)][row] for p, row in zip(passes, rows, strict=True)]
        return SourceDraw(self.clips, np.array(picked, np.int64))


class WindowedSource:
    """Sampler of a large source: each worker holds a window of it.

    Args:
        source: The source.
        cut: Function from recordings to clips.
        count: Clips of the source in a batch.
        seed: Seed, unique within the run.
        window: Recordings of a window, at least one part.
        hop: Seconds between clips; with it, the batches of a window are estimated before it is
            opened.
    """

    windowed = True

    def __init__(
        self,
        source: Source,
        cut: Callable[[Sequence[Recording]], Clips],
        count: int,
        seed: Sequence[int],
        window: int,
        hop: float,
    ) -> None:
        self.source = source
        self.cut = cut
        self.count = count
        self.seed = tuple(seed)
        self.window = window
        self.recordings = np.array([part.recordings for part in source.parts])
        self.clips = np.array(
            [estimate_clips(part.recordings, part.seconds, hop) for part in source.parts]
        )
        self._held: tuple[tuple[int, ...], Clips] | None = None
        self._schedules: dict[tuple[int, int, int], list[tuple[int, list[int]]]] = {}
        self._starts: dict[tuple[int, int], list[int]] = {}

    @property
    def size(self) -> float:
        """Estimated number of clips."""
        return float(self.clips.sum())

    def draw(self, number: int, reader: WorkerId, bad: Bad) -> SourceDraw:
        """Draws the clips of batch ``number`` for a reader's rank."""
        turn, worker = divmod(number, reader.workers)  # torch deals batches to workers in turn
        mine = (reader.rank * reader.workers + worker, reader.world * reader.workers)
        starts = self._starts.setdefault(mine, [0])
        # passes differ in length, as each deals the parts anew: their starts are summed up once
        while starts[-1] <= turn:
            plan = self._schedule(len(starts) - 1, *mine)
            starts.append(starts[-1] + sum(lasts for lasts, _ in plan))
        passed = int(np.searchsorted(starts, turn, side="right")) - 1
        schedule = self._schedule(passed, *mine)
        rest = turn - starts[passed]
        ends = np.cumsum([lasts for lasts, _ in schedule])
        place = int(np.searchsorted(ends, rest, side="right"))
        done = rest - (int(ends[place - 1]) if place else 0)  # batches of the window before this
        clips = self._open(schedule[place][1], bad)
        order = np.random.default_rng([*self.seed, passed, mine[0], place]).permutation(len(clips))
        # the window's length was estimated: where it holds fewer clips, they come again
        rows = np.arange(done * self.count, (done + 1) * self.count) % len(order)
        return SourceDraw(clips, order[rows])

    def _schedule(self, passed: int, reader: int, readers: int) -> list[tuple[int, list[int]]]:
        """Windows of one reader in one pass: the batches of each, and its parts."""
        key = (passed, reader, readers)
        if key not in self._schedules:
            if len(self._schedules) > 4:  # one list of parts a pass: a long run has many passes
                self._schedules.pop(next(iter(self._schedules)))
            # one order for all readers, dealt out: within a pass each part is read once
            order = np.random.default_rng([*self.seed, passed]).permutation(len(self.recordings))
            # with fewer parts than readers, some readers share a part
            parts = (
                order[reader::readers] if len(order) >= readers else order[[reader % len(order)]]
            )
            before = np.cumsum(self.recordings[parts]) - self.recordings[parts]
            groups = np.split(parts, np.flatnonzero(np.diff(before // self.window)) + 1)
            count = max(1, self.count)  # 0 where all clips are pairs
            self._schedules[key] = [
                (max(1, round(self.clips[g].sum() / count)), g.tolist()) for g in groups
            ]
        return self._schedules[key]

    def _open(self, parts: Sequence[int], bad: Bad) -> Clips:
        """Open a window, or the following parts if nothing in it is readable."""
        key = tuple(parts)
        if self._held is None or self._held[0] != key:
            self._held = None  # the old one is let go before the new one is opened
            numbers = list(parts)
            for _ in range(_MAX_EMPTY):
                recordings = self.source.open(numbers, bad)
                if recordings:
                    self._held = key, self.cut(recordings)
                    break
                numbers = [(numbers[-1] + 1) % len(self.source.parts)]
            else:
                raise DataError(
                    f"{_MAX_EMPTY} shards of {self.source.name or 'the data'} in a row have "
                    "nothing that can be read; download or pack them again"
                )
        return self._held[1]


def estimate_clips(recordings: int, seconds: float, hop: float) -> float:
    """Estimate the number of clips of some recordings."""
    # a recording shorter than a clip still gives one
    return max(recordings, seconds / hop)
