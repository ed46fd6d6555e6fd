"""Background frames, with a check for touch while they are taken."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from tactileforge.errors import SensorError
from tactileforge.sensors.health import TROUBLES, exposure_trouble

#: Side of the averaged squares, pixels: averaging 64 pixels divides independent noise by 8.
_SQUARE = 8
#: Largest number of odd first frames, as of a camera just opened (at most a third of all), and the
#: share of changed squares of an odd frame: no touch changes half of the picture in one frame.
_ODD, _ODD_SHARE = 10, 0.5


@dataclass(frozen=True, kw_only=True)
class Background:
    """Options of the background taken before each take.

    Attributes:
        seconds: Duration, s; 0 for no background.
        frames: Number of frames to keep.
        threshold: Largest change of the picture meanwhile, grey levels.
    """

    seconds: float = 1.0
    frames: int = 5
    threshold: float = 4.0


def squares(image: NDArray[np.uint8], camera: bool) -> NDArray[np.float32]:
    """Mean of every square of 8 x 8 pixels, float32 (h, w, 3); of an array, its taxels.

    Args:
        image: uint8 (H, W, 3).
        camera: Whether the image is from a camera.
    """
    if not camera:
        return image.astype(np.float32)
    height, width = image.shape[:2]
    size = (max(1, width // _SQUARE), max(1, height // _SQUARE))
    small = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
    return np.asarray(small, np.float32)


def variation(frames: Sequence[NDArray[np.uint8]], camera: bool = True) -> float:
    """Variation of images over time, grey levels.

    The mean of every square of 8 x 8 pixels is compared with its median over all pictures; a
    hundredth of the squares may change more than the result.

    Args:
        frames: uint8 (H, W, 3) each, at least one.
        camera: Whether the images are from a camera; taxels are compared one by one.
    """
    small = np.stack([squares(frame, camera) for frame in frames])
    change = np.abs(small - np.median(small, axis=0))
    return max(float(np.percentile(difference, 99)) for difference in change)


def check_background(
    name: str, frames: Sequence[NDArray[np.uint8]], threshold: float, camera: bool = True
) -> Sequence[NDArray[np.uint8]]:
    """Check frames for use as a background, and drop odd first ones of a camera.

    Args:
        name: Name of the sensor, for messages.
        frames: uint8 (H, W, 3) each, over a second or so.
        threshold: Largest `variation`, grey levels.
        camera: Whether the frames are from a camera.

    Raises:
        SensorError: No picture, a black or saturated one, or motion on the gel.
    """
    if not frames:
        raise SensorError(f"{name}: no frame came for its background; does it still run?")
    if camera:
        frames = without_odd_first(frames, threshold)
    if trouble := exposure_trouble(frames[len(frames) // 2]):
        raise SensorError(f"{name}: its background is {trouble}: {TROUBLES[trouble]}")
    change = variation(frames, camera)
    if change > threshold:
        first = ", throw more first frames away with warmup= of the camera" if camera else ""
        raise SensorError(
            f"{name}: something touches it, or its light flickers: its pictures change by "
            f"{change:.1f} grey levels while nothing should touch. Lift everything off and start "
            f"again{first}, or allow more: background.threshold={threshold:g} is the limit"
        )
    return frames


def without_odd_first(
    frames: Sequence[NDArray[np.uint8]], threshold: float
) -> Sequence[NDArray[np.uint8]]:
    """Drop first frames with a different picture: black, green, half read.

    Args:
        frames: uint8 (H, W, 3) each, at least one.
        threshold: Smallest change of a changed square, grey levels.
    """
    most = min(_ODD, len(frames) // 3)
    if not most:
        return frames
    rest = np.median([squares(frame, True) for frame in frames[most:]], axis=0)
    odd = 0
    for number, frame in enumerate(frames[:most], 1):
        change = np.abs(squares(frame, True) - rest).max(-1)
        if np.mean(change > threshold) > _ODD_SHARE:
            # up to the last odd one: between two of them, a frame of the old buffer may look right
            odd = number
    return frames[odd:]


def spread_frames(frames: Sequence[NDArray[np.uint8]], count: int) -> list[NDArray[np.uint8]]:
    """Select ``count`` frames, spread evenly."""
    count = min(count, len(frames))
    step = (len(frames) - 1) / max(1, count - 1)
    return [frames[round(place * step)] for place in range(count)]
