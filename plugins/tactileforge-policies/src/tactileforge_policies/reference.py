"""The reference press: how strongly the pictures of one finger answer a known touch."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactileforge.errors import DataError

#: Label of a recording: the gain of its finger, see `reference_gain`.
GAIN_LABEL = "reference_gain"
#: Change of a reference press at a gain of 1, root mean square over the picture, grey levels: that
#: of a middling unit of DIGIT, so that few pictures leave the range of a byte.
NOMINAL = 12.0
#: Smallest change of a reference press, root mean square, grey levels; less is noise.
_FAINT = 1.0


def reference_gain(rest: NDArray[np.uint8], press: NDArray[np.uint8], finger: str) -> float:
    """Change of the picture in a reference press, over `NOMINAL`.

    The root mean square depends less on the noise of a picture than the mean of absolute changes.

    Args:
        rest: Picture of the finger without contact, uint8 (H, W, 3).
        press: Picture in the reference press, of the same shape.
        finger: Name of the finger, for the message.

    Raises:
        DataError: The shapes differ, or the press changes the picture by no more than noise does.

    Example:
        >>> rest = np.full((4, 4, 3), 100, np.uint8)
        >>> reference_gain(rest, rest + 24, "left")
        2.0
    """
    if rest.shape != press.shape:
        raise DataError(
            f"reference press of {finger}: {press.shape}, and its background is {rest.shape}; give "
            "both as the sensor takes them"
        )
    change = float(np.sqrt(np.mean((press.astype(np.float32) - rest) ** 2)))
    if change < _FAINT:
        raise DataError(
            f"reference press of {finger}: it changes the picture by {change:.2g} grey levels; "
            "press the known body onto the gel, and take the background without it"
        )
    return change / NOMINAL


def with_gain(frames: NDArray[np.uint8], rest: NDArray[np.uint8], gain: float) -> NDArray[np.uint8]:
    """Divides the change from the background by the gain of the finger.

    Args:
        frames: Pictures, uint8 (..., H, W, 3).
        rest: Picture without contact, uint8 (H, W, 3).
        gain: Gain of the finger, above 0; see `reference_gain`.
    """
    still = rest.astype(np.float32)
    return np.clip(np.rint(still + (frames - still) / gain), 0, 255).astype(np.uint8)


def gain_of(labels: Mapping[str, Any], key: str) -> float:
    """Gain of a recording, from its label.

    Args:
        labels: Labels of the recording.
        key: Key of the recording, for the message.

    Raises:
        DataError: The label is missing, or no number above 0.
    """
    gain = labels.get(GAIN_LABEL)
    if gain is None:
        raise DataError(
            f"{key}: no reference press (label {GAIN_LABEL!r}), and data.reference_press=true "
            "needs it; record the demonstrations again with `tactileforge demos`, or give "
            "data.reference_press=false"
        )
    if not isinstance(gain, float | int) or not np.isfinite(gain) or gain <= 0:
        raise DataError(f"{key}: label {GAIN_LABEL!r} is {gain!r}; give a number above 0")
    return float(gain)
