"""Detection of frozen, black and saturated images, for recording and live view."""

from __future__ import annotations

from collections import Counter

import numpy as np
from numpy.typing import NDArray

from tactileforge.contracts import Frame, SensorSpec

#: Problems with their fixes.
TROUBLES = {
    "frozen": "the same picture again and again: plug the sensor out and in",
    "black": "pictures are black: is its light on, is exposure= too low?",
    "saturated": "pictures are saturated: lower exposure=, or cover the sensor from other light",
    "light": "the light has changed since the background was taken: keep other light away, fix the "
    "exposure, and take the background again",
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


class Health:
    """Checks of the images of one sensor, one after the other.

    Taxel arrays (they may repeat themselves at rest) and wrench sensors (without pictures) are not
    checked.

    Args:
        spec: Spec of the sensor.
        frozen_after: Seconds of one picture until the sensor counts as frozen.

    Attributes:
        counts: Number of pictures with each of `TROUBLES`.
    """

    def __init__(self, spec: SensorSpec, frozen_after: float = FROZEN_AFTER) -> None:
        self.spec = spec
        self.frozen_after = frozen_after
        self.counts: Counter[str] = Counter()
        self._last: NDArray[np.uint8] | None = None
        self._since = 0.0

    def look(self, frame: Frame) -> str:
        """Check an image: returns its problem, one of `TROUBLES`; "" for none."""
        if self.spec.kind != "image":
            return ""
        trouble = self._frozen(frame) or exposure_trouble(frame.array)
        if trouble:
            self.counts[trouble] += 1
        return trouble

    def _frozen(self, frame: Frame) -> str:
        last, self._last = self._last, frame.array
        # a few pixels tell most pictures apart; only if they are equal, all are compared
        if (
            last is None
            or not np.array_equal(last[::_STEP, ::_STEP], frame.array[::_STEP, ::_STEP])
            or not np.array_equal(last, frame.array)
        ):
            self._since = frame.time
            return ""
        return "frozen" if frame.time - self._since >= self.frozen_after else ""


def exposure_trouble(picture: NDArray[np.uint8]) -> str:
    """Exposure of a picture, uint8 (H, W, 3): ``black``, ``saturated``, or "" for neither."""
    seen = picture[::_STEP, ::_STEP]
    # counting is ten times as fast as a percentile, and only dark pictures need one
    lit = np.count_nonzero(seen >= _DARK)
    if lit <= 0.01 * seen.size + 1 and np.percentile(seen, 99) < _DARK:
        return "black"
    return "saturated" if np.count_nonzero(seen > _BRIGHT) > 0.5 * seen.size else ""
