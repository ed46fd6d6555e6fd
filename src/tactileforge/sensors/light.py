"""Detection of changed light, as opposed to touch.

Light changes slowly over the picture: brighter all over, an exposure that is adjusted, an LED that
dims, daylight from one side. A touch has edges. So a blur takes away little of the change that
light makes, mostly less than a tenth of it, and more than a fifth of what real touches do (public
recordings: tests/sensors/test_light.py).

Daylight that leaks in at an edge may be narrow, with an edge of its own. It makes every colour
brighter, most at the border, and ever less inwards; a touch makes a colour brighter on one of its
sides and darker on the other.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import cv2
import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from torch import Tensor

#: Cells along the shorter side of a picture that is looked at, and deviation of the blur, cells.
_CELLS, _BLUR = 32, 1.5
#: Least change of the picture that is looked at, grey levels: below, forces were within .2 N of 0.
_LEAST = 5.0
#: Light has at most this share of its change in edges, and edges of at most so many grey levels.
_SHARE, _EDGE = 0.2, 8.0
#: Robust fit of gain and offset: share of the cells that agree, rounds, and variance (grey levels
#: squared) that keeps a background of one colour from having a gain.
_AGREE, _ROUNDS, _FLAT = 60, 3, 25.0
#: Of a leak: how far a colour may get darker, or brighter inwards, grey levels and share of the
#: change; least of the brightest colour that the others have, and of the change at the border.
_SLACK, _SLACK_SHARE, _WHITE, _BORDER = 2.0, 0.1, 0.3, 0.6
#: Grey levels from which on a cell is too bright to tell how much daylight it has.
_FULL = 250


class LightCheck:
    """Whether pictures differ from a background as light does, not as a touch.

    Args:
        background: uint8 (H, W, 3), without contact.

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
        height, width = background.shape[:2]
        scale = min(1.0, _CELLS / min(height, width))
        self._size = max(1, round(width * scale)), max(1, round(height * scale))
        self._still = self._small(background)

    def __call__(self, picture: NDArray[np.uint8]) -> bool:
        """Whether the light has changed and nothing touches.

        Args:
            picture: uint8 (H, W, 3), of the background's size.
        """
        small = self._small(picture)
        change = small - self._still
        strongest = float(np.percentile(np.abs(change).max(-1), 99))
        if strongest < _LEAST:
            return False
        # with more edges than that it is no smooth light: the fit is not needed
        if _edges(change) < 2 * _EDGE:
            left = _edges(self._without_gain(change))
            if left < min(_EDGE, _SHARE * strongest):
                return True
        return _is_leak(change, small >= _FULL)

    def _small(self, picture: NDArray[np.uint8]) -> NDArray[np.float32]:
        small = cv2.resize(picture, self._size, interpolation=cv2.INTER_AREA)
        return np.asarray(small, np.float32)

    def _without_gain(self, change: NDArray[np.float32]) -> NDArray[np.float32]:
        """The change without the gain and offset of each colour that most cells agree on."""
        rest = np.empty_like(change)
        for colour in range(3):
            shown, still = change[..., colour], self._still[..., colour]
            use = np.ones(shown.shape, bool)
            for _ in range(_ROUNDS):
                x, y = still[use], shown[use]
                gain = np.mean((x - x.mean()) * (y - y.mean())) / (x.var() + _FLAT)
                left = shown - y.mean() - gain * (still - x.mean())
                use = np.abs(left) <= np.percentile(np.abs(left), _AGREE)
            rest[..., colour] = left
        return rest


def _edges(change: NDArray[np.float32]) -> float:
    """What a blur takes away from a change; a hundredth of the cells may have more, grey levels."""
    blurred = cv2.GaussianBlur(change, (0, 0), _BLUR, borderType=cv2.BORDER_REFLECT_101)
    return float(np.percentile(np.abs(change - blurred).max(-1), 99))


def _is_leak(change: NDArray[np.float32], full: NDArray[np.bool_]) -> bool:
    """Whether a change is daylight at a border: all colours brighter, and ever less inwards.

    Args:
        change: float32 (h, w, 3), grey levels.
        full: bool (h, w, 3), where the picture cannot get brighter.
    """
    strongest = float(np.percentile(change.max(-1), 99))
    slack = max(_SLACK, _SLACK_SHARE * strongest)
    if np.percentile(change.min(-1), 1) < -slack:  # most touches end here
        return False
    change = np.where(full, np.maximum(change, strongest), change)
    most = np.percentile(change, 99, axis=(0, 1))
    for side in range(4):
        inwards = np.rot90(change, side)
        border = np.percentile(inwards[:2], 90, axis=(0, 1))
        if border.min() < _WHITE * border.max() or (border < _BORDER * most).any():
            continue
        rise = inwards - np.minimum.accumulate(inwards, axis=0)
        if np.percentile(rise.max(-1), 99) <= slack:
            return True
    return False


def changed_light(clips: Tensor, backgrounds: Tensor) -> NDArray[np.bool_]:
    """Whether the light has changed in each frame of clips; bool (B, T).

    Args:
        clips: uint8 (B, T, 3, H, W).
        backgrounds: uint8 (B, 3, H, W).
    """
    if min(clips.shape[-2:]) < _CELLS:  # taxels, or too few pixels to tell an edge
        return np.zeros(clips.shape[:2], bool)
    frames = clips.permute(0, 1, 3, 4, 2).cpu().contiguous().numpy()
    stills = backgrounds.permute(0, 2, 3, 1).cpu().contiguous().numpy()
    rows = [
        [check(frame) for frame in clip]
        for clip, check in zip(frames, map(LightCheck, stills), strict=True)
    ]
    return np.array(rows, bool).reshape(len(frames), -1)
