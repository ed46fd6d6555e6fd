"""Light of a unit, and the size of its pixels."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from tactileforge.errors import DataError
from tactileforge.sensors import BackgroundLight

#: Change of a pixel that counts as contact, grey levels.
_LEAST = 3.0
#: Rows and columns of the coarse background.
_GRID = (3, 4)
#: Step between the radii in the search for the rim, pixels.
_STEP = 0.5


def estimate_light(
    backgrounds: Sequence[NDArray[np.float32]], reference: BackgroundLight | None = None
) -> BackgroundLight:
    """Estimates the light of a unit.

    Args:
        backgrounds: Images without contact, of one size, float32 (H, W, 3) each.
        reference: Light to balance the colours to; None makes the three means equal.

    Raises:
        DataError: A colour is black, so no factor balances it.
    """
    still = np.median(np.stack(backgrounds), axis=0).astype(np.float64)
    colour = still.mean((0, 1))
    if (colour < 1).any():
        raise DataError(
            f"mean colours of the background are {np.round(colour, 1).tolist()}: a colour is "
            "black; check the lights and the exposure"
        )
    wanted = colour.mean() if reference is None else np.array(reference.colour)
    coarse = cv2.resize(still, _GRID[::-1], interpolation=cv2.INTER_AREA)
    return BackgroundLight(
        colour=np.round(colour, 2).tolist(),
        balance=np.round(wanted / colour, 4).tolist(),
        grid=np.round(coarse, 1).tolist(),
    )


def light_drift(now: NDArray[np.float32], then: BackgroundLight) -> float:
    """Largest difference of a background to a calibration, over 3 x 4 parts, grey levels.

    Args:
        now: Image without contact, float32 (H, W, 3).
        then: Light of the calibration.
    """
    coarse = cv2.resize(now, _GRID[::-1], interpolation=cv2.INTER_AREA)
    return float(np.abs(coarse - np.array(then.grid)).max())


def punch_mm_per_pixel(
    frames: Iterable[NDArray[np.uint8]], rest: NDArray[np.float32], diameter: float, name: str
) -> float:
    """Size of a pixel, mm, from a press of a flat round punch of known diameter.

    The image changes most at the rim of the punch, where the gel is steepest. The radius of the rim
    is the radius of the largest change, averaged over all directions. It lies a little outside of
    the punch, most for a deep press: on simulated gels the size is up to 7 % too small at 0.3 mm,
    14 % at 0.8 mm, and 20 % in images of 96 rows.

    Args:
        frames: Frames of one press, uint8 (H, W, 3) each.
        rest: Background, float32 (H, W, 3).
        diameter: Diameter of the punch, mm.
        name: Name of the recording, for messages.

    Raises:
        DataError: No frame shows contact, or the contact has no rim inside the image.
    """
    changes = (np.abs(frame.astype(np.float32) - rest).mean(-1) for frame in frames)
    # a generator, so that only the change of one frame is in memory
    deepest = max(changes, key=lambda change: float(change.mean()))
    change = cv2.GaussianBlur(deepest, (0, 0), 1.5)
    felt = (change - max(2 * _LEAST, 0.25 * float(change.max()))).clip(min=0)
    if not felt.any():
        raise DataError(f"{name}: no frame shows contact; press the punch harder")
    rows, columns = np.indices(change.shape)
    # opened by 3 x 3 pixels: specks of noise would widen the smallest circle around the contact
    mask = (felt > 0).astype(np.uint8)
    mask = cv2.morphologyEx(mask, cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
    points = np.argwhere(mask if mask.any() else felt > 0).astype(np.float32)
    centre = cv2.minEnclosingCircle(points)[0]  # row and column, as the points are
    radius = np.hypot(rows - centre[0], columns - centre[1])
    room = min(*centre, *(n - 1 - c for n, c in zip(change.shape, centre, strict=True)))
    places = (radius[radius < room] / _STEP).astype(int)
    if len(places) < 50:
        raise DataError(f"{name}: the contact lies at the edge of the image; press its middle")
    counts = np.bincount(places)
    profile = np.bincount(places, change[radius < room]) / counts.clip(min=1)
    profile = np.convolve(profile, np.ones(3) / 3, "same")
    at = int(profile.argmax())
    if at < 4 or at > len(profile) - 4:
        raise DataError(f"{name}: the punch has no rim inside the image; press its middle")
    # the maximum of the parabola through three points is finer than the step of the radii
    low, top, high = profile[at - 1 : at + 2]
    bend = low - 2 * top + high
    peak = at + (0.5 * (low - high) / bend if bend < 0 else 0.0)
    return float(diameter / 2 / ((peak + 0.5) * _STEP))
