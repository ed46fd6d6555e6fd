"""Contract of pixels for readers and models: uint8, 0 to 255, RGB."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactileforge.contracts import Frames
from tactileforge.errors import DataError

#: Bits a channel of cameras with more than 8, in the lower bits of 16.
_DEPTHS = (10, 12, 14, 16)
#: Largest excess of a value over white, as a share, that is taken for rounding.
_ROUNDING = 0.01


def checked_pixels(array: Any, where: str, axes: int | None = None) -> NDArray[np.uint8]:
    """Check an array for uint8 (..., H, W, 3), and return it.

    Args:
        array: Pixels.
        where: Name of the picture, for messages.
        axes: Required number of axes; None takes 3 or more.

    Raises:
        DataError: Another type or shape; the message says how to convert it.

    Example:
        >>> checked_pixels(np.zeros((2, 4, 4, 3), np.uint8), "take 1").shape
        (2, 4, 4, 3)
    """
    if not isinstance(array, np.ndarray):
        raise DataError(
            f"{where}: expected a numpy array of uint8, (H, W, 3), found {type(array).__name__}"
        )
    if array.dtype != np.uint8:
        raise DataError(
            f"{where}: expected uint8 values from 0 to 255, found {array.dtype}{value_fix(array)}"
        )
    if array.ndim < 3 or array.shape[-1] != 3 or axes not in (None, array.ndim) or 0 in array.shape:
        raise DataError(
            f"{where}: expected (H, W, 3), RGB, found {array.shape}{channel_fix(array.shape)}"
        )
    return array


def is_deep(dtype: np.dtype[Any]) -> bool:
    """Whether values are of 16 bits, in either order of bytes."""
    return dtype.kind == "u" and dtype.itemsize == 2


def white_of(most: float) -> int:
    """White of a camera with a usual number of bits, by the largest value of some frames.

    Args:
        most: Largest value, 65535 or less.

    Example:
        >>> white_of(900), white_of(3987), white_of(65535)
        (1023, 4095, 65535)
    """
    return next((1 << bits) - 1 for bits in _DEPTHS if most < 1 << bits)


def pixels_of(values: NDArray[Any], white: float | None, where: str) -> NDArray[np.uint8]:
    """Pixels of fractions, or of 16 bits.

    Args:
        values: Pictures; uint8 stays as it is.
        white: Value of white; None leaves all as it is.
        where: Name of the pictures, for messages.

    Raises:
        DataError: A value is not finite, or not between 0 and white.

    Example:
        >>> pixels_of(np.array([0, 2048, 4095], np.uint16), 4095, "0.png").tolist()
        [0, 128, 255]
    """
    if values.dtype == np.uint8 or white is None:
        return values
    low, high = float(np.min(values)), float(np.max(values))  # NaN where there is one
    if not -_ROUNDING * white <= low <= high <= (1 + _ROUNDING) * white:
        raise DataError(
            f"{where}: values from {low:.4g} to {high:.4g}, where 0 to {white:g} is expected; "
            "correct `white`, or the file"
        )
    pixels: NDArray[np.uint8] = np.rint(values * (255 / white)).clip(0, 255).astype(np.uint8)
    return pixels


def checked_chunks(
    frames: Frames, rows: Sequence[int], where: str, most: int
) -> Iterator[NDArray[np.uint8]]:
    """Read and check frames a few at a time: memory does not grow with their number.

    Args:
        frames: Frames of a recording.
        rows: Numbers of the frames to read.
        where: Name of the recording, for messages.
        most: Largest number of frames of a chunk.

    Raises:
        DataError: A frame cannot be decoded, or is of another type or shape.
    """
    for start in range(0, len(rows), most):
        yield checked_pixels(frames.read(rows[start : start + most]), where, 4)


def channel_fix(shape: tuple[int, ...]) -> str:
    """Fix for a wrong number of channels, as part of an error; "" without one."""
    if shape and shape[-1] == 4:
        return "; leave out the alpha: [..., :3]"
    if len(shape) == 2 or (shape and shape[-1] == 1):
        return (
            "; a sensor's pictures have colours: repeat grey ones three times along the last axis"
        )
    return ""


def value_fix(array: NDArray[Any]) -> str:
    """Range of pixels of another type than uint8, and their conversion, as part of an error.

    Args:
        array: Pixels of another type.

    Example:
        >>> value_fix(np.array([0.0, 1.0]))
        ' from 0 to 1: convert with np.rint(255 * x).astype(np.uint8)'
        >>> value_fix(np.array([0, 4000], np.uint16))
        ' from 0 to 4e+03: scale 12 bits to 8 with (x >> 4).astype(np.uint8)'
    """
    if array.size == 0 or array.dtype.kind not in "biuf":
        return ""
    bad = 0 if array.dtype.kind != "f" else int((~np.isfinite(array)).sum())
    if bad:
        return f", {bad} of its values NaN or infinite: no colour stands for these; leave them out"
    low, high = float(array.min()), float(array.max())
    span = f" from {low:.3g} to {high:.3g}"
    if low < 0:
        return f"{span}: give the frames as they were before normalisation"
    whole = array.dtype.kind in "iu"
    if high > 255:
        if whole:
            bits = next((bits for bits in _DEPTHS if high < 2**bits), 0)
            if bits:
                return f"{span}: scale {bits} bits to 8 with (x >> {bits - 8}).astype(np.uint8)"
        return f"{span}: scale them to 0..255 by what the camera calls white"
    if whole:
        return f"{span}: convert with x.astype(np.uint8)"
    scaled = "x" if high > 1 else "255 * x"
    return f"{span}: convert with np.rint({scaled}).astype(np.uint8)"
