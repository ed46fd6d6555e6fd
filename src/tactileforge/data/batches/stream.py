"""Batches of a run, each a pure function of its number.

So there is no state to save or restore. Every batch holds the same number of clips of each source,
and the same number of pairs for matching: memory is constant, and ranks do equal work.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import numpy as np
from torch.utils.data import Dataset, Sampler

from tactileforge.contracts import Batch
from tactileforge.data.batches.clips import Clips, Skipped, collate
from tactileforge.data.batches.pairs import Item, Pairs
from tactileforge.data.batches.source_samplers import (
    FullSource,
    SourceDraw,
    WindowedSource,
    WorkerId,
)


class Stream(Dataset[Batch]):
    """Map-style data set of whole batches, each a pure function of its number.

    Args:
        tracks: Samplers of the sources; their counts and ``n_pairs`` make up a batch.
        n_pairs: Pairs of a batch, drawn from all clips at hand.
        seed: Seed of the run.
        reader: Rank and worker of this reader.
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
        """Read batch ``number`` of the run, counted from 0."""
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
            clips, cached = [draw.clips for draw in draws], self._pairs
            # by identity: windows are swapped whole, so equal objects mean equal labels
            if cached is None or any(a is not b for a, b in zip(cached[0], clips, strict=True)):
                labels = zip(*(each.labels() for each in clips), strict=True)
                objects, sensors, actions = (np.concatenate(column) for column in labels)
                self._pairs = cached = clips, Pairs(objects, sensors, actions)
            if pairs := cached[1]:
                drawn = pairs.draw(self.n_pairs, rng)
            else:  # no pairs in this window: single clips keep the size of the batch
                drawn = [(int(i), -1) for i in rng.integers(bounds[-1], size=2 * self.n_pairs)]
            for clip, group in drawn:
                track = int(np.searchsorted(bounds, clip, side="right")) - 1
                items[track].append((clip - int(bounds[track]), group))

        for source_items, draw in zip(items, draws, strict=True):
            source_items += [(int(row), -1) for row in draw.rows]
        return items

    def _note(self, line: str, count: int) -> None:
        self._bad[line] = line, count


class BatchIndexSampler(Sampler[int]):
    """Sampler of batch numbers, from the current step of the run to the end of the epoch.

    Args:
        length: Batches of an epoch.
        position: Function that returns the number of finished batches of the run.
    """

    def __init__(self, length: int, position: Callable[[], int] = lambda: 0) -> None:
        self.length = length
        self.position = position

    def __len__(self) -> int:
        return self.length

    def __iter__(self) -> Iterator[int]:
        start = self.position()
        yield from range(start, (start // self.length + 1) * self.length)
