"""Detection of pictures with swapped red and blue, by the resting picture of the same gel."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
from numpy.typing import NDArray

#: Compared pixels along the shorter side.
_LOOKED_AT = 32
#: Smallest difference from the background to look into, grey levels of red and blue together; and
#: its largest remainder after exchanging them, as a share. Half of the pixels may touch.
_LEAST, _REMAINS = 12.0, 0.5


def are_swapped(pictures: NDArray[np.uint8], background: NDArray[np.uint8]) -> NDArray[np.bool_]:
    """Whether pictures look like their background with red and blue exchanged; bool (...).

    Args:
        pictures: uint8 (..., H, W, 3), RGB.
        background: uint8 (..., H, W, 3), without contact; one for each, or one for all.

    Example:
        >>> rest = np.full((64, 48, 3), (140, 100, 80), np.uint8)
        >>> are_swapped(np.stack([rest, rest[..., ::-1]]), rest)
        array([False,  True])
    """
    step = max(1, min(background.shape[-3:-1]) // _LOOKED_AT)
    shown, still = (x[..., ::step, ::step, ::2].astype(np.int16) for x in (pictures, background))
    as_is, put_right = _difference(shown, still), _difference(shown[..., ::-1], still)
    swapped: NDArray[np.bool_] = (as_is >= _LEAST) & (put_right <= _REMAINS * as_is)
    return swapped


def warn_of_swapped(
    what: str, pictures: NDArray[np.uint8], background: NDArray[np.uint8], stacklevel: int = 3
) -> None:
    """Warn once of pictures with red and blue exchanged in comparison with the background.

    Args:
        what: Name of the pictures, for the warning.
        pictures: uint8 (..., H, W, 3), RGB.
        background: uint8 (..., H, W, 3), without contact; one for each, or one for all.
        stacklevel: Level of the warning in the stack, as for `warnings.warn`.
    """
    swapped = are_swapped(pictures, background)
    if swapped.any():
        warnings.warn(
            f"{what}: {np.count_nonzero(swapped)} of {swapped.size} have the colours of their "
            "background with red and blue swapped: give both as RGB, where pictures of OpenCV are "
            "BGR (picture[..., ::-1] turns one into the other)",
            stacklevel=stacklevel,
        )


def _difference(shown: NDArray[Any], still: NDArray[Any]) -> NDArray[np.float64]:
    """Median difference of the pixels, red and blue together."""
    found: NDArray[np.float64] = np.median(np.abs(shown - still).sum(-1), axis=(-2, -1))
    return found
