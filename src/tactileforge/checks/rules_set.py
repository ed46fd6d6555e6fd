"""Checks of a set as a whole: TF501 to TF599."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tactileforge.checks.check import Check, Examples, Finding
from tactileforge.checks.codes import CODES
from tactileforge.checks.copies import identical_groups, similar_pairs
from tactileforge.checks.made import made_touch
from tactileforge.checks.seen import Seen
from tactileforge.contracts import Recording

#: Recordings whose pictures are compared with each other: 12 kB each.
_COMPARED = 4000
#: Smallest imprint of copies, grey levels, and its ratio to their difference.
_CLEAR, _LEAD = 12.0, 4.0


@dataclass(frozen=True)
class _Kept:
    """What is kept of a recording for comparison; see `sample.FrameSample`."""

    key: str
    split: str
    digest: bytes
    signature: NDArray[np.int16]
    contact: float
    shape: tuple[int, int]
    imprint: float


class _Copies(Check):
    """Comparison of all decoded recordings."""

    needs = frozenset({"frames", "several", "set"})

    def __init__(self) -> None:
        self._kept: list[_Kept] = []

    def look(self, seen: Seen) -> Iterable[Finding]:
        """See `Check.look`."""
        if len(self._kept) < _COMPARED:
            one = seen.sample
            given = one.digest, one.signature, one.contact, one.shape, one.imprint
            self._kept.append(_Kept(seen.key, seen.split, *given))
        return ()

    def _near(self) -> Iterator[tuple[_Kept, _Kept, float]]:
        """Near copies with an imprint far clearer than their difference: faint ones look alike."""
        for i, j, level in similar_pairs(self._kept):
            one, other = self._kept[i], self._kept[j]
            if min(one.imprint, other.imprint) >= max(_CLEAR, _LEAD * level):
                yield one, other, level

    def _pairs(self) -> Iterator[tuple[_Kept, _Kept, float]]:
        for group in identical_groups(self._kept):
            for other in group[1:]:
                yield self._kept[group[0]], self._kept[other], 0.0
        yield from self._near()


class CopiesAcrossSplits(_Copies):
    """Copies of one recording in training and validation."""

    code, level = CODES["copies_across_splits"], "error"
    title = "Copies in both splits"
    why = (
        "The same pictures, at most encoded again, are trained on and validated on: the numbers "
        "say nothing of new data."
    )
    fix = "remove one of the two, or give both one object and split by it (hold_out: object)"
    unit = "grey levels"
    worst = -1

    def end(self) -> Iterable[Finding]:
        """See `Check.end`."""
        for one, other, level in self._pairs():
            if one.split != other.split:
                yield self.found(
                    one.key, f"shows the pictures of {other.key}, of the other split", level
                )

    @staticmethod
    def examples() -> Examples:
        """A touch and its copy, encoded again."""
        return Examples([made_touch(0), made_touch(1)], [made_touch(0), _copy()])


class SamePixels(_Copies):
    """Recordings with the same pixels."""

    code, level = CODES["same_pixels"], "warning"
    title = "The same pixels twice"
    why = "Two recordings are one: it counts twice, and two labels of it contradict each other."
    fix = "remove one of them"

    def end(self) -> Iterable[Finding]:
        """See `Check.end`."""
        for group in identical_groups(self._kept):
            first, *others = (self._kept[i].key for i in group)
            yield self.found(first, f"has the pixels of {', '.join(others[:8])}", len(others))

    @staticmethod
    def examples() -> Examples:
        """A file under two names."""
        return Examples(
            [made_touch(0), made_touch(1)], [made_touch(0), made_touch(0, key="made/again")]
        )


class NearlyTheSame(_Copies):
    """Recordings that differ as one does from itself encoded again."""

    code, level = CODES["nearly_the_same"], "note"
    title = "Nearly the same recording twice"
    why = (
        "Small pictures at the same places in time differ by less than encoding again does: one "
        "touch counts twice."
    )
    fix = "remove one of them"
    unit = "grey levels"
    worst = -1

    def end(self) -> Iterable[Finding]:
        """See `Check.end`."""
        for one, other, level in self._near():
            yield self.found(one.key, f"differs from {other.key} by {level:.1f} grey levels", level)

    @staticmethod
    def examples() -> Examples:
        """A touch, encoded again."""
        return Examples([made_touch(0), made_touch(1)], [made_touch(0), _copy()])


def _copy() -> Recording:
    """The touch of number 0 with the noise of another encoding."""

    def noisy(frames: NDArray[np.uint8]) -> None:
        frames += np.random.default_rng(9).integers(0, 2, frames.shape, np.uint8)

    return made_touch(0, edit=noisy, key="made/copy")
