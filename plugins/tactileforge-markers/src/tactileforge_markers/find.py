"""Printed markers of a gel, found in its picture without contact."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from tactileforge.errors import DataError

#: Fewest markers of a gel: below, dust would pass for them.
_FEWEST = 6
#: Longest marker, as a share of the picture's shorter side.
_LARGEST = 1 / 6
#: Least contrast of a marker with the gel around it, grey levels.
_FAINTEST = 12.0
#: Smallest marker, pixels.
_SMALLEST = 4
#: Grey levels below which shares of light are noise.
_DARK = 8
#: Areas that count as those of the same print, as shares of their median.
_ALIKE = (0.4, 2.5)
#: Least share of the spots that have to be alike, and of its box that a spot fills; a disc fills
#: pi / 4 of it.
_MOST, _ROUND = 0.6, 0.55
#: Longest side of a marker's box over the other.
_LONG = 1.8


@dataclass(frozen=True)
class MarkerGrid:
    """Markers of a gel at rest.

    Attributes:
        places: float64 (N, 2), x and y of their centres, pixels; (0, 0) is the middle of the first
            pixel. Row by row from the top.
        radius: Radius of a marker, pixels.
        pitch: Median distance of a marker from its nearest neighbour, pixels.
        contrast: Median contrast of markers with the gel around them, grey levels.
        bright: Whether markers are brighter than the gel.
        size: Height and width of the picture.
    """

    places: NDArray[np.float64]
    radius: float
    pitch: float
    contrast: float
    bright: bool
    size: tuple[int, int]

    def shares(self, picture: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """Lack (or excess) of light of each pixel, a share of that around, uint8 (H, W), in 255ths.

        A share does not change with the light on a marker, which a touch changes.
        """
        grey, contrast = _grey_and_spots(picture, 2 * self.radius, self.bright)
        around = grey if self.bright else cv2.add(grey, contrast)
        return np.asarray(cv2.divide(contrast, cv2.add(around, _DARK), scale=255), np.uint8)


def find_markers(reference: NDArray[np.uint8], what: str = "the picture") -> MarkerGrid:
    """Finds the markers in a picture without contact.

    Dark dots are looked for first, then bright ones. Spots count as markers where most of them have
    one size and are round. Those that touch the border are left out.

    Args:
        reference: uint8 (H, W, 3), RGB.
        what: Name of the picture, for errors.

    Raises:
        DataError: It is not an RGB picture, or shows no markers.
    """
    check_picture(reference, what)
    reasons = []

    for bright in (False, True):
        found = _found(reference, bright)
        if isinstance(found, MarkerGrid):
            return found
        reasons.append(f"{'bright' if bright else 'dark'}: {found}")
    raise DataError(
        f"{what}: no markers found ({'; '.join(reasons)}). Give a frame without contact of a gel "
        "with printed dots, sharp and well lit; a gel without dots has no displacement to track"
    )


def check_picture(picture: NDArray[np.uint8], what: str) -> None:
    """Checks the form of a picture.

    Raises:
        DataError: It is not uint8 (H, W, 3), or less than 32 pixels high or wide.
    """
    kind = getattr(picture, "dtype", type(picture).__name__)
    shape: tuple[int, ...] = getattr(picture, "shape", ())
    if kind != np.uint8 or len(shape) != 3 or shape[2] != 3:
        raise DataError(f"{what}: {kind} {shape}; give RGB, uint8 (H, W, 3)")
    if min(shape[:2]) < 32:
        raise DataError(f"{what}: {shape[:2]} pixels; markers need 32 x 32 at least")


def spots(picture: NDArray[np.uint8], diameter: float, bright: bool) -> NDArray[np.uint8]:
    """Contrast of each pixel with the picture around it, as far as it is a spot.

    Colours of a contact are strong in one channel, a printed dot is dark (or bright) in all: the
    brightest (or darkest) channel is taken, and what is narrower than twice the diameter remains.

    Args:
        picture: uint8 (H, W, 3), RGB.
        diameter: Diameter of the spots, pixels.
        bright: Whether they are brighter than their surroundings.

    Returns:
        uint8 (H, W), grey levels.
    """
    return _grey_and_spots(picture, diameter, bright)[1]


def _grey_and_spots(
    picture: NDArray[np.uint8], diameter: float, bright: bool
) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """The channel to look at, and the contrast of its spots."""
    red, green, blue = cv2.split(picture)
    side = 2 * int(np.ceil(0.9 * diameter)) + 3
    grey = cv2.min(cv2.min(red, green), blue) if bright else cv2.max(cv2.max(red, green), blue)
    kind = cv2.MORPH_TOPHAT if bright else cv2.MORPH_BLACKHAT
    contrast = cv2.morphologyEx(grey, kind, np.ones((side, side), np.uint8))
    return np.asarray(grey, np.uint8), np.asarray(contrast, np.uint8)


def centers(
    contrast: NDArray[np.uint8], near: NDArray[np.float64], radius: float, rounds: int = 4
) -> NDArray[np.float64]:
    """Centres of mass of spots, with a moving window.

    Args:
        contrast: uint8 (H, W), see `spots`.
        near: float64 (N, 2), x and y close to the centres, pixels.
        radius: Radius of a spot, pixels.
        rounds: Times that the window moves.

    Returns:
        float64 (N, 2), sub-pixel.
    """
    reach = int(np.ceil(1.5 * radius + 1))
    border = cv2.copyMakeBorder(contrast, *4 * (reach + 1,), cv2.BORDER_CONSTANT, value=0)
    height, width = contrast.shape
    steps = np.arange(-reach, reach + 1)
    down, right = np.meshgrid(steps, steps, indexing="ij")
    found = near.astype(np.float64).copy()
    for _ in range(rounds):
        found = found.clip(0, (width - 1, height - 1))
        middle = np.rint(found).astype(np.int64)
        x, y = middle[:, :1] + right.ravel(), middle[:, 1:] + down.ravel()
        mass = border[y + reach + 1, x + reach + 1].astype(np.float64)
        away = np.hypot(x - found[:, :1], y - found[:, 1:])
        mass *= np.clip(1.4 * radius + 1 - away, 0, 1)  # soft, so that it has no steps
        total = np.maximum(mass.sum(1), 1e-6)
        found = np.stack([(mass * x).sum(1) / total, (mass * y).sum(1) / total], axis=1)
    return found


def _found(reference: NDArray[np.uint8], bright: bool) -> MarkerGrid | str:
    """Markers of one polarity, or the reason for none."""
    height, width = reference.shape[:2]
    largest = _LARGEST * min(height, width)
    contrast = cv2.GaussianBlur(spots(reference, largest / 1.8, bright), (0, 0), 0.7)
    level, _ = cv2.threshold(contrast, 0, 255, cv2.THRESH_BINARY + cv2.THRESH_OTSU)
    if level < _FAINTEST / 2:
        return f"no spot of {_FAINTEST:g} grey levels"
    mask = (contrast > level).astype(np.uint8)
    _, _, boxes, middles = cv2.connectedComponentsWithStats(mask, connectivity=4)
    left, top, wide, high, area = boxes[1:].T
    real = (area >= _SMALLEST) & (np.maximum(wide, high) <= largest)
    inside = (left > 0) & (top > 0) & (left + wide < width) & (top + high < height)
    if (real & inside).sum() < _FEWEST:
        return f"{int((real & inside).sum())} spots, {_FEWEST} at least"
    middle = float(np.median(area[real & inside]))
    fill, long = area / (wide * high), np.maximum(wide, high) / np.minimum(wide, high)
    alike = (area > _ALIKE[0] * middle) & (area < _ALIKE[1] * middle) & (long < _LONG)
    # of fewer than 9 pixels, no shape can be told
    alike &= (fill > _ROUND) | (area < 9)
    kept = real & inside & alike

    if kept.sum() < max(_FEWEST, _MOST * (real & inside).sum()):
        return f"only {int(kept.sum())} of {int((real & inside).sum())} spots have one round shape"
    radius = float(np.sqrt(np.median(area[kept]) / np.pi))
    sharp = spots(reference, 2 * radius, bright)
    places = centers(sharp, middles[1:][kept], radius)
    # row by row: y in steps of two diameters, so that a tilted row stays one
    places = places[np.lexsort((places[:, 0], np.rint(places[:, 1] / max(4 * radius, 1))))]
    x, y = np.rint(places).astype(np.int64).T
    apart = np.hypot(*(places[:, None] - places[None]).transpose(2, 0, 1))
    np.fill_diagonal(apart, np.inf)
    pitch = float(np.median(apart.min(1)))
    strength = float(np.median(sharp[y.clip(0, height - 1), x.clip(0, width - 1)]))
    if strength < _FAINTEST:
        return f"spots of {strength:.0f} grey levels, {_FAINTEST:g} at least"
    return MarkerGrid(places, radius, pitch, strength, bright, (height, width))
