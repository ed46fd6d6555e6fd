"""Batches of a run, each a pure function of its number: nothing to remember, nothing to restore.

Every batch holds the same number of clips of each source, and the same number of pairs for
matching, so memory is constant, and ranks do equal work. A source that is small is sampled as a
whole. Of a large one, every reader (one worker of one rank) holds a *window* of whole parts, takes
clips from it in random order, and moves on; the parts come in an order shuffled anew each pass.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from torch.utils.data import Dataset, Sampler

from tactileforge.contracts import Batch, Recording
from tactileforge.data.batches.clips import Clips, Skipped, collate
from tactileforge.data.batches.pairs import Item, Pairs
from tactileforge.data.batches.sources import Bad, Source
from tactileforge.errors import ConfigError, DataError

#: Windows without a single clip that may come one after another before reading gives up.
_MAX_EMPTY = 20


@dataclass(frozen=True)
class WorkerId:
    """One worker of one rank.

    Attributes:
        rank: The process.
        world: Number of processes.
        workers: Readers of each process.
    """

    rank: int = 0
    world: int = 1
    workers: int = 1


@dataclass(frozen=True)
class SourceDraw:
    """Clips of one source in a batch: those at hand, and the rows drawn, in order."""

    clips: Clips
    rows: NDArray[np.int64]


class FullSource:
    """Sampler of a whole source: an epoch is a permutation of its clips.

    Args:
        clips: All of its clips.
        count: Clips of it in a batch.
        seed: Numbers that no other source of the run has.
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
        picked = [self._order(int(p))[row] for p, row in zip(passes, rows, strict=True)]
        return SourceDraw(self.clips, np.array(picked, np.int64))

    def _order(self, number: int) -> NDArray[np.int64]:
        if number not in self._orders:
            rng = np.random.default_rng([*self.seed, number])
            self._orders[number] = rng.permutation(len(self.clips))
        return self._orders[number]


class WindowedSource:
    """Sampler of a large source, of which each worker holds a window.

    Args:
        source: The source.
        cut: Makes clips of recordings.
        count: Clips of it in a batch.
        seed: Numbers that no other source of the run has.
        window: Recordings of a window; it has at least one part.
        hop: Seconds between clips: says how many batches a window lasts before it is opened.
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
        passed, place, done = self._place(turn, mine)
        clips = self._open(self._schedule(passed, *mine)[place][1], bad)
        order = np.random.default_rng([*self.seed, passed, mine[0], place]).permutation(len(clips))
        # the window's length was estimated: where it holds fewer clips, they come again
        rows = np.arange(done * self.count, (done + 1) * self.count) % len(order)
        return SourceDraw(clips, order[rows])

    def _place(self, turn: int, mine: tuple[int, int]) -> tuple[int, int, int]:
        """Pass and window of a reader's batch, and batches that came before it from there."""
        passed, rest = self._pass(turn, mine)
        ends = np.cumsum([lasts for lasts, _ in self._schedule(passed, *mine)])
        place = int(np.searchsorted(ends, rest, side="right"))
        return passed, place, rest - (int(ends[place - 1]) if place else 0)

    def _pass(self, turn: int, mine: tuple[int, int]) -> tuple[int, int]:
        """Pass over the source, and place within it, of a reader's batch."""
        starts = self._starts.setdefault(mine, [0])
        while starts[-1] <= turn:
            plan = self._schedule(len(starts) - 1, *mine)
            starts.append(starts[-1] + sum(lasts for lasts, _ in plan))
        passed = int(np.searchsorted(starts, turn, side="right")) - 1
        return passed, turn - starts[passed]

    def _schedule(self, passed: int, reader: int, readers: int) -> list[tuple[int, list[int]]]:
        """The windows of one reader in one pass: batches that each lasts, and its parts."""
        key = (passed, reader, readers)
        if key not in self._schedules:
            if len(self._schedules) > 4:
                self._schedules.pop(next(iter(self._schedules)))
            # one order for all readers, dealt out: within a pass each part is read once
            order = np.random.default_rng([*self.seed, passed]).permutation(len(self.recordings))
            # with fewer parts than readers, some readers share a part
            parts = (
                order[reader::readers] if len(order) >= readers else order[[reader % len(order)]]
            )
            before = np.cumsum(self.recordings[parts]) - self.recordings[parts]
            groups = np.split(parts, np.flatnonzero(np.diff(before // self.window)) + 1)
            self._schedules[key] = [
                (max(1, round(self.clips[g].sum() / self.count)), g.tolist()) for g in groups
            ]
        return self._schedules[key]

    def _open(self, parts: Sequence[int], bad: Bad) -> Clips:
        """Opens a window; where nothing in it can be read, the parts that follow by number."""
        key = tuple(parts)
        if self._held is None or self._held[0] != key:
            self._held = None  # the old one is let go before the new one is opened
            wanted = list(parts)
            for _ in range(_MAX_EMPTY):
                recordings = self.source.open(wanted, bad)
                if recordings:
                    self._held = key, self.cut(recordings)
                    break
                wanted = [(wanted[-1] + 1) % len(self.source.parts)]
            else:
                raise DataError(
                    f"{_MAX_EMPTY} shards of {self.source.name or 'the data'} in a row have "
                    "nothing that can be read; download or pack them again"
                )
        return self._held[1]


def estimate_clips(recordings: int, seconds: float, hop: float) -> float:
    """Estimates the number of clips of some recordings."""
    return max(recordings, seconds / hop)


class Stream(Dataset[Batch]):
    """Map-style data set of whole batches, each a pure function of its number.

    Args:
        tracks: What each batch draws from; their counts and ``n_pairs`` make up a batch.
        n_pairs: Pairs of a batch, drawn from all that is at hand.
        seed: Seed of the run.
        reader: Who reads.
        length: Batches of an epoch.
    """

    def __init__(
        self,
        tracks: Sequence[FullSource | WindowedSource],
        n_pairs: int,
        seed: int,
        reader: WorkerId,
        length: int,
    ) -> None:
        self.tracks = tracks
        self.n_pairs = n_pairs
        self.seed = seed
        self.reader = reader
        self.length = length
        self.size = 2 * n_pairs + sum(track.count for track in tracks)
        self._bad: Skipped = {}
        self._pairs: tuple[list[Clips], Pairs] | None = None

    def __len__(self) -> int:
        return self.length

    def __getitem__(self, number: int) -> Batch:
        """Batch ``number`` of the run, counted from 0."""
        draws = [track.draw(number, self.reader, self._note) for track in self.tracks]
        rows = [
            draw.clips[(clip, group)]
            for draw, items in zip(draws, self._items(number, draws), strict=True)
            for clip, group in items
        ]
        batch = collate(rows)
        batch["skipped"] |= self._bad
        self._bad = {}
        return batch

    def items(self, number: int) -> list[list[Item]]:
        """Clips of batch ``number`` by source, with their groups."""
        draws = [track.draw(number, self.reader, self._note) for track in self.tracks]
        return self._items(number, draws)

    def _items(self, number: int, draws: Sequence[SourceDraw]) -> list[list[Item]]:
        items: list[list[Item]] = [[] for _ in draws]
        if self.n_pairs:
            bounds = np.cumsum([0, *(len(draw.clips) for draw in draws)])
            rng = np.random.default_rng([self.seed, number, self.reader.rank, 1])
            pairs = self._pairs_of([draw.clips for draw in draws])
            if pairs:
                drawn = pairs.draw(self.n_pairs, rng)
            else:  # this window has none: the batch keeps its size
                drawn = [(int(i), -1) for i in rng.integers(bounds[-1], size=2 * self.n_pairs)]
            for clip, group in drawn:
                track = int(np.searchsorted(bounds, clip, side="right")) - 1
                items[track].append((clip - int(bounds[track]), group))
        for source_items, draw in zip(items, draws, strict=True):
            source_items += [(int(row), -1) for row in draw.rows]
        return items

    def _pairs_of(self, clips: Sequence[Clips]) -> Pairs:
        cached = self._pairs
        if cached is None or any(a is not b for a, b in zip(cached[0], clips, strict=True)):
            labels = zip(*(each.labels() for each in clips), strict=True)
            objects, sensors, actions = (np.concatenate(column) for column in labels)
            self._pairs = cached = list(clips), Pairs(objects, sensors, actions)
        return cached[1]

    def _note(self, line: str, count: int) -> None:
        self._bad[line] = line, count


class BatchIndexSampler(Sampler[int]):
    """Sampler of batch numbers, from the run's current step to the end of the epoch.

    Args:
        length: Batches of an epoch.
        position: Batches of the run that are already done.
    """

    def __init__(self, length: int, position: Callable[[], int] = lambda: 0) -> None:
        self.length = length
        self.position = position

    def __len__(self) -> int:
        return self.length

    def __iter__(self) -> Iterator[int]:
        start = self.position()
        yield from range(start, (start // self.length + 1) * self.length)


def allocate(
    size: int,
    sources: Sequence[tuple[str, float, frozenset[str]]],
    shares: Mapping[str, float],
) -> list[int]:
    """Allocates the clips of every batch to the sources.

    Args:
        size: Clips to share out.
        sources: Name, weight and labels of each.
        shares: Least share of the clips that is from sources with a label, by label.

    Returns:
        One number a source, at least 1 each; they add up to ``size``.

    Raises:
        ConfigError: More sources than clips, a share that is none, or that no source can serve.

    Example:
        >>> allocate(8, [("a", 3, frozenset()), ("b", 1, frozenset({"force"}))], {"force": 0.5})
        [3, 5]
    """
    if not size:
        return [0] * len(sources)
    weights = np.array([weight for _, weight, _ in sources], np.float64)
    if size < len(sources):
        raise ConfigError(f"{size} clips of a batch for {len(sources)} sources; raise batch.size")
    if not (np.isfinite(weights).all() and (weights > 0).all()):
        raise ConfigError(f"weights of sources are above 0, not {weights.tolist()}")
    counts = np.zeros(len(sources), int)
    left = size
    for label, share in shares.items():
        wanted = round(share * size)
        able = np.array([label in labels for *_, labels in sources])
        if not 0 <= share <= 1 or wanted > left:
            raise ConfigError(f"batch.shares.{label} is {share}; all shares add up to at most 1")
        if wanted and not able.any():
            raise ConfigError(f"batch.shares.{label} is {share}, but no source has {label}")
        if wanted:
            counts[able] += _apportion(wanted, weights[able])
            left -= wanted
    counts += _apportion(left, weights)
    while not counts.all():
        counts[counts.argmin()] += 1
        counts[counts.argmax()] -= 1
    return [int(count) for count in counts]


def _apportion(count: int, weights: NDArray[np.float64]) -> NDArray[np.int64]:
    """Integers in proportion to weights, by the largest-remainder method."""
    exact = count * weights / weights.sum()
    out: NDArray[np.int64] = np.floor(exact).astype(np.int64)
    rest = np.argsort(out - exact, kind="stable")[: count - int(out.sum())]
    out[rest] += 1
    return out
