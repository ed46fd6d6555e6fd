"""Sampler of pairs of clips for matching."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

#: One item of a batch: a clip and its matching group, -1 for none.
Item: TypeAlias = tuple[int, int]


class Pairs:
    """Sampler of clips for matching: a clip, its object by another sensor, its action once more.

    A clip with both labels serves both losses, in a group of three, as in AnyTouch 2, section
    Semantic-Level Tactile Features; other groups are pairs of one object or of one action.

    Args:
        objects: int64 (n,), object of each clip; -1 for unknown.
        sensors: (n,), sensor of each clip.
        actions: int64 (n,), action of each clip; -1 for unknown.
    """

    def __init__(
        self, objects: NDArray[np.int64], sensors: NDArray[Any], actions: NDArray[np.int64]
    ) -> None:
        known = _groups(objects)
        _, self._sensor = np.unique(sensors, return_inverse=True)
        by_sensor = [[clips[group] for group in _groups(self._sensor[clips])] for clips in known]
        # the only object has no negative: its pairs would teach nothing
        self._by_sensor = [s for s in by_sensor if len(s) > 1 and len(known) > 1]
        groups = _groups(actions)
        self._by_action = [clips for clips in groups if len(clips) > 1 and len(groups) > 1]
        self._object = _places([np.concatenate(s) for s in self._by_sensor], len(objects))
        self._action = _places(self._by_action, len(objects))

    def __bool__(self) -> bool:
        return bool(self._by_sensor or self._by_action)

    def draw(self, count: int, rng: np.random.Generator) -> list[Item]:
        """Draw ``2 * count`` clips in groups of two or three, by object and by action in turn."""
        items: list[Item] = []
        left, group = 2 * count, 0
        while left > 1:
            # in turn, so that neither kind depends on how common the other is
            of_object = bool(self._by_sensor) and (group % 2 == 0 or not self._by_action)
            clips = self._of_object(rng) if of_object else self._of_action(rng)
            if left not in (2, 4):  # four are two pairs: one of four would be without a partner
                clips += self._action_of(clips, rng) if of_object else self._object_of(clips, rng)
            items += [(int(clip), group) for clip in clips]
            left, group = left - len(clips), group + 1
        return items + [(items[0][0], -1)] * left

    def _of_object(self, rng: np.random.Generator) -> list[int]:
        """Two clips of one object by two sensors."""
        shares = self._by_sensor[rng.integers(len(self._by_sensor))]
        # sensors first, then clips: a sensor with many clips is not favoured
        two = rng.choice(len(shares), 2, replace=False)
        return [rng.choice(shares[i]) for i in two]

    def _of_action(self, rng: np.random.Generator) -> list[int]:
        """Two clips of one action."""
        clips = self._by_action[rng.integers(len(self._by_action))]
        return list(rng.choice(clips, 2, replace=False))

    def _action_of(self, pair: Sequence[int], rng: np.random.Generator) -> list[int]:
        """Another clip with the action of the first of a pair; [] without one."""
        if (action := self._action[pair[0]]) < 0:
            return []
        clips = self._by_action[action]
        others = clips[~np.isin(clips, pair)]
        return [rng.choice(others)] if len(others) else []

    def _object_of(self, pair: Sequence[int], rng: np.random.Generator) -> list[int]:
        """A clip of the object of the first of a pair, by another sensor; none without one."""
        if (found := self._object[pair[0]]) < 0:
            return []
        shares = [s for s in self._by_sensor[found] if self._sensor[s[0]] != self._sensor[pair[0]]]
        others = shares[rng.integers(len(shares))]
        others = others[others != pair[1]]
        return [rng.choice(others)] if len(others) else []


def _places(groups: Sequence[NDArray[np.int64]], count: int) -> NDArray[np.int64]:
    """Number of the group of each of ``count`` clips, -1 for none."""
    places = np.full(count, -1)
    for number, clips in enumerate(groups):
        places[clips] = number
    return places


def _groups(values: NDArray[Any]) -> list[NDArray[np.int64]]:
    """Indices of each non-negative value, by ascending value."""
    order = np.argsort(values, kind="stable")
    order = order[values[order] >= 0]  # -1 is unknown, and matches nothing
    if not len(order):
        return []
    return np.split(order, np.flatnonzero(np.diff(values[order])) + 1)
