"""Detection of changed light, as opposed to touch.

Light changes slowly over the picture: brighter all over, another exposure, a dimmed LED, daylight
from one side. A touch has edges. So a blur takes away little of a change of light, mostly less than
a tenth of it. Of real touches it takes .18 or more, or 8 grey levels (public recordings:
tests/sensors/test_light.py).

A change all over is found beside a touch, too: it moves every colour at all four borders the same
way. Touches move none of them, or some colours, or some borders (the weakest of public ones by 1
grey level at most, or .021 of its light).

Daylight that leaks in at an edge may be narrow, with an edge of its own. It makes every colour
brighter, most at the border, and ever less inwards; a touch makes a colour brighter on one of its
sides and darker on the other.

During a touch, other light that does not reach every border is detected only with the presses of
the unit's own calibration: see `borders`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from torch import Tensor

#: Smallest number of cells along the shorter side of a picture, if it has so many pixels.
CELLS = 30
#: Deviation of the blur, cells.
_BLUR = 1.5
#: Smallest change of the picture to check, grey levels: below, forces were within .2 N of 0.
_LEAST = 5.0
#: Largest share of the change in edges for light, and largest edge, grey levels; from the touches
#: above.
_SHARE, _EDGE = 0.18, 8.0
#: Robust fit of gain and offset: percent of the cells in agreement, rounds, and a prior variance
#: (grey levels squared): without it, a background of one colour would have any gain.
_AGREE, _ROUNDS, _FLAT = 60, 3, 25.0
#: Change all over: width of a border, cells; smallest change of the weakest colour at the weakest
#: border, grey levels, if it is also this share of its light (of a few grey levels more: dark ones
#: are noisy), or clear by itself; and smallest median of all, grey levels.
_WIDE, _WEAKEST, _FAINTEST, _DARK, _CLEAR, _MEDIAN = 3, 1.5, 0.03, 3.0, 3.0, 4.0
#: Smallest share of the strongest change that a border shows where the light has changed.
_REACH = 0.25
#: Largest level of the borders, as a share of the median, at which they are dark.
_DIM = 1 / 3
#: Leak: tolerance for a colour darker, or brighter inwards, grey levels and share of the change;
#: smallest ratio of the weakest colour to the strongest at the border; smallest share of the change
#: at the border, and largest at the opposite one (a bar across the picture reaches both).
_SLACK, _SLACK_SHARE, _WHITE, _BORDER, _OPPOSITE = 2.0, 0.1, 0.3, 0.6, 0.5
#: Grey levels of a saturated cell: it hides the amount of daylight.
_FULL = 250


class LightCheck:
    """Check of pictures against a background for changed light.

    Args:
        background: Picture without contact, uint8 (H, W, 3).

    Example:
        >>> rest = np.full((64, 48, 3), 100, np.uint8)
        >>> LightCheck(rest)(rest + 8)
        True
        >>> touched = rest.copy()
        >>> touched[20:40, 20:40] = 140
        >>> LightCheck(rest)(touched)
        False
    """

    def __init__(self, background: NDArray[np.uint8]) -> None:
        self._side = max(1, min(background.shape[:2]) // CELLS)
        self._still = self._small(background)
        self._colours = _by_colour(self._still)
        self._at_borders = _borders(self._still)
        # a gel behind a round window, or in a frame: its borders tell nothing
        self._is_dark_around = self._at_borders.max() < _DIM * np.median(self._still)

    def __call__(self, picture: NDArray[np.uint8]) -> bool:
        """Whether the light has changed, all over or where nothing touches.

        Args:
            picture: uint8 (H, W, 3), with the size of the background.
        """
        small = self._small(picture)
        change = small - self._still
        strongest = _nearly_largest(_over_colours(np.maximum, np.abs(change)))
        if strongest < _LEAST:
            return False
        at_borders = _borders(change)
        if _is_all_over(at_borders, self._at_borders):
            return True
        # a broad smooth imprint has few edges too, but leaves the borders as they were. The fit can
        # at best halve the edges, so with more than twice the limit it is not needed
        reaches_border = np.abs(at_borders).max() > _REACH * strongest
        if (reaches_border or self._is_dark_around) and _edges(change) < 2 * _EDGE:
            left = _edges(self._without_gain(change))
            if left < min(_EDGE, _SHARE * strongest):
                return True
        return _is_leak(change, small >= _FULL)

    def _small(self, picture: NDArray[np.uint8]) -> NDArray[np.float32]:
        """Means of whole cells, float32 (h, w, 3), without incomplete ones at two sides."""
        rows, columns = (length // self._side for length in picture.shape[:2])
        whole = picture[: rows * self._side, : columns * self._side]
        small = cv2.resize(whole, (columns, rows), interpolation=cv2.INTER_AREA)
        return np.asarray(small, np.float32)

    def _without_gain(self, change: NDArray[np.float32]) -> NDArray[np.float32]:
        """Remainder of a change after a robust fit of gain and offset to each colour."""
        still, shown = self._colours, _by_colour(change)
        use, left = np.ones_like(still), still
        for _ in range(_ROUNDS):
            share = use / use.sum(1, keepdims=True)
            x, y = (levels - _sums(levels, share) for levels in (still, shown))
            weighted = x * share
            left = y - _sums(weighted, y) / (_sums(weighted, x) + _FLAT) * x
            far = np.abs(left)
            use = (far <= _ranked(far, _AGREE)[:, None]).astype(np.float32)
        return np.ascontiguousarray(left.T).reshape(change.shape)


def _by_colour(small: NDArray[np.float32]) -> NDArray[np.float32]:
    """Small picture with a row for each colour, (3, h w)."""
    return np.ascontiguousarray(small.reshape(-1, 3).T)


def _sums(one: NDArray[np.float32], other: NDArray[np.float32]) -> NDArray[np.float32]:
    """Sums of products along rows, (3, n) each to (3, 1)."""
    out: NDArray[np.float32] = np.einsum("ij,ij->i", one, other)[:, None]
    return out


def _over_colours(which: np.ufunc, levels: NDArray[Any]) -> NDArray[Any]:
    """Apply a ufunc over the colours, (..., 3) to (...); numpy is slow along an axis of 3."""
    out: NDArray[Any] = which(which(levels[..., 0], levels[..., 1]), levels[..., 2])
    return out


def _ranked(levels: NDArray[np.float32], percent: int) -> NDArray[np.float32]:
    """Percentile along the last axis, without interpolation."""
    rank = levels.shape[-1] * percent // 100
    return np.partition(levels, rank, axis=-1)[..., rank]


def _nearly_largest(levels: NDArray[np.float32]) -> float:
    """Percentile 99 of all levels."""
    return float(_ranked(levels.ravel(), 99))


def edges_of(change: NDArray[np.float32]) -> NDArray[np.float32]:
    """Edges of a change, grey levels (h, w): its difference from a blur, largest of the colours."""
    blurred = cv2.GaussianBlur(change, (0, 0), _BLUR, borderType=cv2.BORDER_REFLECT_101)
    edges: NDArray[np.float32] = _over_colours(np.maximum, np.abs(change - blurred))
    return edges


def _edges(change: NDArray[np.float32]) -> float:
    """Size of the edges of a change, grey levels: their percentile 99."""
    return _nearly_largest(edges_of(change))


def _borders(small: NDArray[np.float32]) -> NDArray[np.float32]:
    """Median of each colour at each of the four borders, float32 (4, 3)."""
    across = small.transpose(1, 0, 2)
    sides = (small[:_WIDE], small[-_WIDE:], across[:_WIDE], across[-_WIDE:])
    return np.stack([_ranked(_by_colour(side), 50) for side in sides])


def _is_all_over(change: NDArray[np.float32], still: NDArray[np.float32]) -> bool:
    """Whether every colour is brighter, or every one darker, at each of the four borders.

    Args:
        change: float32 (4, 3), change at the borders, grey levels.
        still: float32 (4, 3), borders of the background, grey levels.
    """
    if not ((change > 0).all() or (change < 0).all()):
        return False
    size = np.abs(change)
    if size.min() < _WEAKEST or np.median(size) < _MEDIAN:
        return False
    return bool(size.min() >= _CLEAR or (size / (still + _DARK)).min() >= _FAINTEST)


def _is_leak(change: NDArray[np.float32], full: NDArray[np.bool_]) -> bool:
    """Whether a change is daylight at a border: all colours brighter, and ever less inwards.

    Args:
        change: float32 (h, w, 3), grey levels.
        full: bool (h, w, 3), mask of saturated cells.
    """
    strongest = _nearly_largest(_over_colours(np.maximum, change))
    slack = max(_SLACK, _SLACK_SHARE * strongest)
    if _nearly_largest(-_over_colours(np.minimum, change)) > slack:  # most touches end here
        return False
    # a saturated cell shows less than its true change, and would look like a dip on the way inwards
    change = np.where(full, np.maximum(change, strongest), change)
    most = _ranked(_by_colour(change), 99)
    for side in range(4):
        inwards = np.rot90(change, side)
        border = _ranked(_by_colour(inwards[:2]), 90)
        if border.min() < _WHITE * border.max() or (border < _BORDER * most).any():
            continue
        if (_ranked(_by_colour(inwards[-2:]), 99) > _OPPOSITE * most).any():
            continue
        rise = inwards - np.minimum.accumulate(inwards, axis=0)
        if _nearly_largest(_over_colours(np.maximum, rise)) <= slack:
            return True
    return False


def changed_light(clips: Tensor, backgrounds: Tensor) -> NDArray[np.bool_]:
    """Whether the light has changed in each frame of clips; bool (B, T).

    Args:
        clips: uint8 (B, T, 3, H, W).
        backgrounds: uint8 (B, 3, H, W).
    """
    if min(clips.shape[-2:]) < CELLS:  # taxels, or too few pixels for an edge
        return np.zeros(clips.shape[:2], bool)
    frames = clips.permute(0, 1, 3, 4, 2).cpu().contiguous().numpy()
    stills = backgrounds.permute(0, 2, 3, 1).cpu().contiguous().numpy()
    rows = [
        [check(frame) for frame in clip]
        for clip, check in zip(frames, map(LightCheck, stills), strict=True)
    ]
    return np.array(rows, bool).reshape(len(frames), -1)
