"""Which clips make which batch: a pure function of (seed, step, rank)."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray
from torch.utils.data import Sampler

#: One item of a batch: a clip and its matching group, -1 for none.
Item = tuple[int, int]


class Pairs:
    """Pairs of clips for matching: one object by two sensors, or one action.

    Args:
        objects: int64 (n,), object of each clip; -1 unknown.
        sensors: int64 (n,), sensor of each clip.
        actions: int64 (n,), action of each clip; -1 unknown.
    """

    def __init__(
        self, objects: NDArray[np.int64], sensors: NDArray[np.int64], actions: NDArray[np.int64]
    ) -> None:
        known = np.unique(objects[objects >= 0])
        self._by_sensor = []
        for value in known:
            clips = np.flatnonzero(objects == value)
            shares = [clips[sensors[clips] == s] for s in np.unique(sensors[clips])]
            if len(shares) > 1 and len(known) > 1:  # the only object has no negative
                self._by_sensor.append(shares)
        groups = [np.flatnonzero(actions == value) for value in np.unique(actions[actions >= 0])]
        self._by_action = [clips for clips in groups if len(clips) > 1 and len(groups) > 1]

    def __bool__(self) -> bool:
        return bool(self._by_sensor or self._by_action)

    def draw(self, count: int, rng: np.random.Generator) -> list[Item]:
        """``count`` pairs, by object and by action in turn; each is one group."""
        items: list[Item] = []
        for group in range(count):
            of_object = bool(self._by_sensor) and (group % 2 == 0 or not self._by_action)
            if of_object:
                shares = self._by_sensor[rng.integers(len(self._by_sensor))]
                two = rng.choice(len(shares), 2, replace=False)
                pair = [rng.choice(shares[i]) for i in two]
            else:
                clips = self._by_action[rng.integers(len(self._by_action))]
                pair = list(rng.choice(clips, 2, replace=False))
            items += [(int(clip), group) for clip in pair]
        return items


class Batches(Sampler[list[Item]]):
    """Batches of a run, each a pure function of its number.

    A fixed share of every batch is drawn in pairs for matching. The rest goes through all clips in
    an order shuffled anew each epoch. All batches have one size, on every rank.

    Args:
        clips: Number of clips.
        size: Clips of a batch, on one rank.
        seed: Seed of the run.
        pairs: Source of pairs, or None.
        share: Share of a batch that is drawn in pairs.
        rank: This process.
        world: Number of processes.
        multiple: The number of batches of an epoch is a multiple of this.
        position: Batches of the run that are already done; an iteration goes on from there to the
            end of the epoch.
    """

    def __init__(
        self,
        clips: int,
        size: int,
        seed: int,
        pairs: Pairs | None = None,
        share: float = 0.0,
        rank: int = 0,
        world: int = 1,
        multiple: int = 1,
        position: Callable[[], int] = lambda: 0,
    ) -> None:
        self.clips = clips
        self.seed = seed
        self.pairs = pairs
        self.couples = round(share * size / 2) if pairs else 0
        self.size = size
        self.rank, self.world = rank, world
        self.position = position
        each = max(1, size - 2 * self.couples) * world
        self.length = max(1, clips // each // multiple) * multiple

    def __len__(self) -> int:
        return self.length

    def __iter__(self) -> Iterator[list[Item]]:
        start = self.position()
        stop = (start // self.length + 1) * self.length
        order: NDArray[np.int64] | None = None
        for number in range(start, stop):
            if order is None:
                order = self._order(number // self.length)
            yield self._batch(number, order)

    def batch(self, number: int) -> list[Item]:
        """Batch ``number`` of the run, counted from 0."""
        return self._batch(number, self._order(number // self.length))

    def _order(self, epoch: int) -> NDArray[np.int64]:
        return np.random.default_rng([self.seed, epoch]).permutation(self.clips)

    def _batch(self, number: int, order: NDArray[np.int64]) -> list[Item]:
        plain = self.size - 2 * self.couples
        items: list[Item] = []
        if self.couples and self.pairs:
            rng = np.random.default_rng([self.seed, number, self.rank, 1])
            items = self.pairs.draw(self.couples, rng)
        first = ((number % self.length) * self.world + self.rank) * plain
        rows = np.arange(first, first + plain) % self.clips
        return items + [(int(clip), -1) for clip in order[rows]]
