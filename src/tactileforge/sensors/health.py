"""Detection of frozen, black and saturated images, for recording and live view."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tactileforge.contracts import Frame

#: Problems with their fixes.
TROUBLES = {
    "frozen": "the same picture again and again: plug the sensor out and in",
    "black": "pictures are black: is its light on, is exposure= too low?",
    "saturated": "pictures are saturated: lower exposure=, or cover the sensor from other light",
    "light": "the light has changed since the background was taken: keep other light away, fix the "
    "exposure, and take the background again",
    "other_light": "the borders changed as in none of the presses of the calibration, by another "
    "light or a touch in a new place: keep other light away, or calibrate with such presses too",
    "out_of_range": "the force is beyond what the sensor's scale knows: press less, or take the "
    "background again",
}
#: Seconds of one picture until the sensor counts as frozen: noise makes any two frames differ.
FROZEN_AFTER = 1.0
#: Grey levels: a picture is black if all but a hundredth of its values are below the first, and
#: saturated if half of them are above the second.
_DARK, _BRIGHT = 8, 250
#: Step of the pixels looked at, in both directions.
_STEP = 8


class FrozenPictures:
    """Comparison of each picture of a camera with the one before."""

    def __init__(self) -> None:
        self._last: NDArray[np.uint8] | None = None
        self._since = 0.0

    def look(self, frame: Frame) -> bool:
        """Whether the same picture has come for `FROZEN_AFTER` seconds."""
        last, self._last = self._last, frame.array
        # a few pixels tell most pictures apart; only if they are equal, all are compared
        if (
            last is None
            or not np.array_equal(last[::_STEP, ::_STEP], frame.array[::_STEP, ::_STEP])
            or not np.array_equal(last, frame.array)
        ):
            self._since = frame.time
            return False
        return frame.time - self._since >= FROZEN_AFTER


def exposure_trouble(picture: NDArray[np.uint8]) -> str:
    """Exposure of a picture, uint8 (H, W, 3): ``black``, ``saturated``, or "" for neither."""
    seen = picture[::_STEP, ::_STEP]
    # counting is ten times as fast as a percentile, and only dark pictures need one
    lit = np.count_nonzero(seen >= _DARK)
    if lit <= 0.01 * seen.size + 1 and np.percentile(seen, 99) < _DARK:
        return "black"
    return "saturated" if np.count_nonzero(seen > _BRIGHT) > 0.5 * seen.size else ""
