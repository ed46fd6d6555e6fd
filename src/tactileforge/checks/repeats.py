"""Frames stored more often than the camera gave them."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from tactileforge.checks.doubts import Suspicion

#: Largest change between two stored copies of one frame, as a share of the usual change between
#: two frames of a moving gel: encoding again leaves a little.
_SAME = 0.1
#: Smallest usual change of a moving gel, grey levels.
_MOVES = 0.05
#: Smallest number of frames of the camera in a stretch, and of repeated ones.
_LEAST, _REPEATS = 8, 4
#: Smallest share of repeated frames, and of the regular runs among all.
_SHARE, _REGULAR = 0.15, 0.9
#: Largest spread of the frames of the camera around an even rhythm, stored frames.
_UNEVEN = 1.6
#: Longest run of copies: more is a camera that stood still.
_LONGEST = 12
#: In a film, whose coder refines copies: how often each frame may be stored, the largest change of
#: a copy as a share of the new frames beside it, the smallest share of such copies, the largest
#: usual change, and the smallest change of new frames, grey levels. Others reach 0.6 and 0.4.
_FILMED, _BESIDE, _COPIES, _USUAL, _CLEAR = (2, 3), 0.5, 0.7, 0.36, 0.2


def repeated(changes: NDArray[np.float64], rate: float) -> Suspicion | None:
    """Find frames stored twice, thrice, or 18 as 30; a gel at rest is not told.

    Args:
        changes: Mean change from each frame to the next in a stretch, grey levels, (n,).
        rate: Stored frames a second, Hz.
    """
    share = _share_of_copies(changes) or _share_in_film(changes)
    if not share:
        return None
    given = rate * (1 - share)
    words = (
        f"{_share(share)} of the frames repeat the one before: the camera gave about "
        f"{given:.3g} a second, not {rate:.3g}"
    )
    return Suspicion("repeated_frames", share, words)


def _share_of_copies(changes: NDArray[np.float64]) -> float:
    """Share of frames hardly different from the one before; 0 for none."""
    moving = changes[changes > 0]
    if not len(moving):
        return 0.0
    usual = float(np.median(moving[moving >= 0.25 * np.quantile(moving, 0.9)]))
    if usual < _MOVES:
        return 0.0
    new = np.flatnonzero(changes > _SAME * usual)
    # frames of the camera between the first and the last change: how often each was stored
    runs = np.diff(new)
    runs = _longest_without(runs, _LONGEST)
    if len(runs) < _LEAST or runs.sum() - len(runs) < _REPEATS:
        return 0.0
    share = 1 - len(runs) / float(runs.sum())
    low = int(np.floor(runs.mean()))
    # sampling at another rate stores each frame so many times, or once more, in an even rhythm
    is_regular = np.isin(runs, (low, low + 1)).mean() >= _REGULAR and _is_even(runs)
    return share if share >= _SHARE and is_regular else 0.0


def _share_in_film(changes: NDArray[np.float64]) -> float:
    """Share of repeated frames in a film with each frame two or three times; 0 for none.

    The coder of a film goes on to refine a picture in its copies, by up to half of a usual change.
    """
    for times in _FILMED:
        for first in range(times):
            new = changes[first::times]
            count = len(new) - 1
            if count < _LEAST or np.median(new) < _CLEAR:
                continue
            copies = changes[first : first + count * times].reshape(count, times)[:, 1:]
            less = copies / np.maximum(np.minimum(new[:-1], new[1:])[:, None], 1e-9)
            if (less < _BESIDE).mean() >= _COPIES and np.median(less) <= _USUAL:
                return 1 - 1 / times
    return 0.0


def every(share: float) -> float:
    """Stored frames for each of the camera, from the share of repeated ones.

    Example:
        >>> every(0.5), every(0.4)
        (2.0, 1.67)
    """
    factor = 1 / (1 - share)
    whole = round(factor)
    return float(whole) if abs(factor - whole) < 0.06 * whole else round(factor, 2)


def _longest_without(runs: NDArray[np.int64], most: int) -> NDArray[np.int64]:
    """Longest part without a run over a length: where the gel moves all the time."""
    edges = [-1, *np.flatnonzero(runs > most).tolist(), len(runs)]
    parts = [runs[a + 1 : b] for a, b in pairwise(edges)]
    return max(parts, key=len)


def _is_even(runs: NDArray[np.int64]) -> bool:
    """Whether copies come in an even rhythm, as by sampling, and not at random or together."""
    at = np.cumsum(runs) - runs.mean() * np.arange(1, len(runs) + 1)
    return float(np.ptp(at)) <= _UNEVEN


def _share(share: float) -> str:
    for value, words in ((1 / 2, "half"), (2 / 3, "two thirds"), (3 / 4, "three quarters")):
        if abs(share - value) < 0.02:
            return words
    return f"{100 * share:.0f} %"
