"""Colours of a gel at rest, to detect swapped red and blue, and turned pictures.

A picture is reduced to its colours without brightness on a grid of four by four. Lights sit at
fixed sides of a sensor, so the colours of two units agree in place though not in strength. Swapped
or turned ones agree once corrected.
"""

from __future__ import annotations

from itertools import permutations
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

#: Smallest agreement (a cosine) of corrected colours, and its smallest lead over that of the
#: original ones. On real units without a swap, the corrected ones are behind by 0.4 or more.
SWAPPED, SWAPPED_BY = 0.5, 0.2
#: The same for a quarter turn: a GelSight Mini looks similar on its side (0.7, and 0.9 upright).
TURNED, TURNED_BY = 0.7, 0.1
#: Smallest lead of a mirrored picture over all that are turned alone.
MIRRORED_BY = 0.2
#: Smallest lead of another order than RGB and BGR over the colours as they are, for `TURNED`.
_OTHER_ORDER = 0.3
#: Sensors with coloured lights.
COLOURED = frozenset({"digit", "gelsight", "gelsight_mini", "gelslim"})
#: Largest spread of the channels of a grey picture, and smallest of a coloured one; grey levels.
_GREY, _COLOURS = 1.5, 6.0
#: Largest level of a black picture.
_BLACK = 8.0

#: Means over public units (10 DIGITs, 9 GelSight Minis), upright, in hundredths: rows of red, green
#: and blue, each less their mean.
_KNOWN = {
    "digit": (
        ((-1, 21, -20), (7, 19, -26), (-10, 26, -16), (-51, 57, -6)),
        ((183, -103, -80), (154, -52, -102), (19, 78, -97), (-94, 166, -72)),
        ((155, -144, -11), (69, -80, 11), (-92, 94, -2), (-145, 179, -33)),
        ((29, -86, 58), (-61, -46, 107), (-129, 46, 83), (-128, 130, -2)),
    ),
    "gelsight_mini": (
        ((-209, 98, 111), (-213, 69, 145), (-215, 71, 145), (-196, 66, 130)),
        ((-150, 48, 102), (-100, -20, 120), (-105, -12, 117), (-136, 21, 115)),
        ((-105, 40, 65), (-5, -40, 45), (-12, -31, 43), (-87, 16, 71)),
        ((-83, 74, 9), (-26, 31, -5), (-27, 33, -6), (-65, 48, 17)),
    ),
}


def colour_grid(picture: NDArray[Any]) -> NDArray[np.float64]:
    """Colours of a picture without brightness, float64 (4, 4, 3); 0 for grey.

    Args:
        picture: Picture, (H, W, 3), RGB, grey levels of 255.
    """
    small = cv2.resize(picture.astype(np.float32), (4, 4), interpolation=cv2.INTER_AREA)
    levels = small.astype(np.float64)
    out: NDArray[np.float64] = levels - levels.mean(axis=-1, keepdims=True)
    return out


def known_colours(sensor: str) -> NDArray[np.float64] | None:
    """Colour grid of a type of sensor; None for an unknown one.

    Args:
        sensor: Name of the type.
    """
    rows = _KNOWN.get(sensor)
    return None if rows is None else np.array(rows, np.float64)


def colour_agreement(one: NDArray[np.float64], other: NDArray[np.float64]) -> float:
    """Agreement of two colour grids, a cosine: 1 for equal, 0 for unrelated, -1 for opposite.

    Args:
        one: Result of `colour_grid`.
        other: Another result of it.
    """
    size = float(np.sqrt((one * one).sum() * (other * other).sum()))
    return float((one * other).sum()) / size if size > 0 else 0.0


def is_swapped(grid: NDArray[np.float64], reference: NDArray[np.float64]) -> bool:
    """Whether colours fit a reference with red and blue exchanged, and not as they are.

    Args:
        grid: `colour_grid` of an upright picture.
        reference: `colour_grid` of another picture, or of the type of sensor.

    Example:
        >>> digit = known_colours("digit")
        >>> is_swapped(digit[..., ::-1], digit), is_swapped(digit, digit)
        (True, False)
    """
    as_is, put_right = (
        colour_agreement(grid, reference),
        colour_agreement(grid[..., ::-1], reference),
    )
    return put_right >= SWAPPED and put_right - as_is >= SWAPPED_BY


def has_other_order(grid: NDArray[np.float64], reference: NDArray[np.float64]) -> bool:
    """Whether colours fit a reference in another order than RGB and BGR, in any orientation.

    Args:
        grid: `colour_grid` of a picture.
        reference: `colour_grid` of an upright picture of the type of sensor.

    Example:
        >>> digit = known_colours("digit")
        >>> has_other_order(digit[..., [1, 2, 0]], digit), has_other_order(digit, digit)
        (True, False)
    """
    fits = {
        order: max(
            colour_agreement(np.rot90(grid[..., list(order)], -n), reference) for n in range(4)
        )
        for order in permutations(range(3))
    }
    best = max(fits, key=lambda order: fits[order])
    is_clear = fits[best] >= TURNED and fits[best] - fits[0, 1, 2] >= _OTHER_ORDER
    return is_clear and best not in ((0, 1, 2), (2, 1, 0))


def turn_of(grid: NDArray[np.float64], reference: NDArray[np.float64]) -> int | None:
    """Degrees, clockwise, to put a picture upright; None if its colours are ambiguous.

    Args:
        grid: `colour_grid` with the channels in the order of the reference.
        reference: `colour_grid` of an upright picture.

    Example:
        >>> digit = known_colours("digit")
        >>> turn_of(np.rot90(digit), digit)  # it lies on its left side
        90
    """
    fits = [colour_agreement(np.rot90(grid, -quarter), reference) for quarter in range(4)]
    order = np.argsort(fits)[::-1]
    best, second = fits[order[0]], fits[order[1]]
    is_sure = best >= TURNED and best - second >= TURNED_BY
    return int(90 * order[0]) if is_sure else None


def mirror_of(grid: NDArray[np.float64], reference: NDArray[np.float64]) -> str:
    """Axis along which a picture is mirrored, ``x`` or ``y``; "" for none, or if unsure.

    Args:
        grid: `colour_grid` with the channels in the order of the reference.
        reference: `colour_grid` of an upright picture, not mirrored.

    Example:
        >>> digit = known_colours("digit")
        >>> mirror_of(digit[:, ::-1], digit), mirror_of(digit[::-1], digit), mirror_of(digit, digit)
        ('x', 'y', '')
    """
    leads = mirror_leads(grid, reference)
    best = max(leads, key=lambda axis: leads[axis])
    across, along = (colour_agreement(one, reference) for one in (grid[:, ::-1], grid[::-1]))
    is_clear = max(across, along) >= TURNED and abs(across - along) >= TURNED_BY
    return best if is_clear and leads[best] >= MIRRORED_BY else ""


def mirror_leads(grid: NDArray[np.float64], reference: NDArray[np.float64]) -> dict[str, float]:
    """Lead of a mirrored picture over all that are turned alone, by the axis of the mirror.

    Args:
        grid: `colour_grid` with the channels in the order of the reference.
        reference: `colour_grid` of an upright picture, not mirrored.

    Returns:
        Differences of agreements, for ``x`` and ``y``; below 0 for a picture without a mirror.
    """
    as_is = max(colour_agreement(np.rot90(grid, -n), reference) for n in range(4))
    across, along = (colour_agreement(one, reference) for one in (grid[:, ::-1], grid[::-1]))
    return {"x": across - as_is, "y": along - as_is}


def is_grey(picture: NDArray[Any]) -> bool:
    """Whether the three channels of a picture are equal.

    Args:
        picture: Picture, (H, W, 3), grey levels of 255.
    """
    levels = picture.astype(np.float32)
    # a black picture has lost its colours, too, but for another reason
    is_lit = float(np.quantile(levels, 0.99)) > _BLACK
    return is_lit and float(np.quantile(levels.max(-1) - levels.min(-1), 0.999)) <= _GREY


def has_colours(grid: NDArray[np.float64]) -> bool:
    """Whether a colour grid is more than the tint of a camera.

    Args:
        grid: Result of `colour_grid`.
    """
    return float(np.sqrt((grid * grid).mean())) >= _COLOURS
