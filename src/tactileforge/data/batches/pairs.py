"""Sampler of pairs of clips for matching."""

from __future__ import annotations

from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

#: One item of a batch: a clip and its matching group, -1 for none.
Item: TypeAlias = tuple[int, int]


class Pairs:
    """Sampler of pairs of clips: one object by two sensors, or one action.

    Args:
        objects: int64 (n,), object of each clip; -1 for unknown.
        sensors: (n,), sensor of each clip.
        actions: int64 (n,), action of each clip; -1 for unknown.
    """

    def __init__(
        self, objects: NDArray[np.int64], sensors: NDArray[Any], actions: NDArray[np.int64]
    ) -> None:
        known = _groups(objects)
        _, sensor = np.unique(sensors, return_inverse=True)
        by_sensor = [[clips[group] for group in _groups(sensor[clips])] for clips in known]
        # the only object has no negative: its pairs would teach nothing
        self._by_sensor = [s for s in by_sensor if len(s) > 1 and len(known) > 1]
        groups = _groups(actions)
        self._by_action = [clips for clips in groups if len(clips) > 1 and len(groups) > 1]

    def __bool__(self) -> bool:
        return bool(self._by_sensor or self._by_action)

    def draw(self, count: int, rng: np.random.Generator) -> list[Item]:
        """Draw ``count`` pairs, by object and by action in turn; each is one group."""
        items: list[Item] = []
        for group in range(count):
            # in turn, so that neither kind of pair depends on how common the other is
            of_object = bool(self._by_sensor) and (group % 2 == 0 or not self._by_action)
            if of_object:
                shares = self._by_sensor[rng.integers(len(self._by_sensor))]
                # sensors first, then clips: a sensor with many clips is not favoured
                two = rng.choice(len(shares), 2, replace=False)
                pair = [rng.choice(shares[i]) for i in two]
            else:
                clips = self._by_action[rng.integers(len(self._by_action))]
                pair = list(rng.choice(clips, 2, replace=False))
            items += [(int(clip), group) for clip in pair]
        return items


def _groups(values: NDArray[Any]) -> list[NDArray[np.int64]]:
    """Indices of each non-negative value, by ascending value."""
    order = np.argsort(values, kind="stable")
    order = order[values[order] >= 0]  # -1 is unknown, and matches nothing
    if not len(order):
        return []
    return np.split(order, np.flatnonzero(np.diff(values[order])) + 1)
