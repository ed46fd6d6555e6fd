"""Recordings as touches: the background, and the strongest contact."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from tactileforge_inspect.frame_stats import evenly

from reality import measures
from reality.measures import Array
from tactileforge.contracts import Recording
from tactileforge.data import size_text
from tactileforge.errors import DataError

#: Number of searched frames per part of a recording, for the strongest contact.
_FRAMES = 24
#: Largest number of background frames to read.
_STILL = 15
#: Frames per touch of a long recording, and largest number of touches of a recording.
_LONG, _MOST = 64, 8


@dataclass(frozen=True)
class StrongestTouch:
    """A recording at its strongest contact.

    Attributes:
        key: Key of the recording.
        sensor: Type of the sensor.
        background: float32 (H, W, 3), grey levels, at most `measures.SIDE` on the shorter side.
        picture: float32 (H, W, 3), the frame most different from the background, grey levels.
        touched: bool (H, W), its contact; all False for a faint touch.
        noise: Standard deviation of a pixel over time, grey levels; NaN if unknown.
    """

    key: str
    sensor: str
    background: NDArray[np.float32]
    picture: NDArray[np.float32]
    touched: NDArray[np.bool_]
    noise: float

    @property
    def change(self) -> NDArray[np.float32]:
        """The image minus the background."""
        return self.picture - self.background


def strongest_touches(recording: Recording, most: int = _MOST) -> list[StrongestTouch]:
    """Reads the strongest frame of each part of a recording.

    Args:
        recording: The recording; a long one has several parts of at least 64 frames each.
        most: Largest number of parts.

    Returns:
        A touch per part; empty for a recording without a background.

    Raises:
        DataError: A frame cannot be decoded, or the background's size differs from the frames'.
    """
    still = recording.no_contact
    if still is None:
        return []
    if still.shape != recording.frames.shape:
        raise DataError(
            f"{recording.key}: the background has {size_text(still.shape)} pixels, the frames "
            f"{size_text(recording.frames.shape)}; give a background of the same size"
        )
    first = still.read(range(min(len(still), _STILL)))
    background = np.median(first, axis=0).astype(np.float32)
    level = measures.noise([measures.sized(image) for image in first])
    count = len(recording.frames)
    parts = np.array_split(np.arange(count), max(1, min(most, count // _LONG)))
    pictures = (_strongest(recording, part, background) for part in parts)
    return [
        StrongestTouch(
            key=recording.key,
            sensor=recording.sensor,
            background=measures.sized(background),
            picture=picture,
            touched=measures.contact(picture - measures.sized(background)),
            noise=level,
        )
        for picture in pictures
    ]


def _strongest(recording: Recording, part: Array, background: Array) -> NDArray[np.float32]:
    """The frame most different from the background, among some of a part of a recording."""
    rows = part[evenly(len(part), _FRAMES)].tolist()
    frames = recording.frames.read(rows)
    away = [float(np.abs(frame - background).mean()) for frame in frames]
    return measures.sized(frames[int(np.argmax(away))])


@dataclass(frozen=True)
class TouchMeasures:
    """The numbers of one touch, see `measures`.

    Attributes:
        bands: float64 (4,), power in bands, decades; see `measures.bands`.
        spectrum: float64 (40,), power density in rings, squared grey levels.
        noise: Standard deviation of a pixel over time, grey levels.
        area: Contact area, as a share of the image.
        contrast: Mean absolute change in the contact, grey levels.
        inside: Fine detail in the contact, grey levels.
        outside: Fine detail away from the contact, grey levels.
        ground: float64 (3,), mean of each channel of the background, grey levels.
        covariance: float64 (3, 3), covariance of the channels' changes, squared grey levels.
    """

    bands: Array
    spectrum: Array
    noise: float
    area: float
    contrast: float
    inside: float
    outside: float
    ground: Array
    covariance: Array


def measure_touch(touch: StrongestTouch) -> TouchMeasures | None:
    """Measures of a touch; None for a faint one."""
    if np.count_nonzero(touch.touched) < 9:
        return None
    change = touch.change
    inside, outside = measures.detail(change, touch.touched)
    return TouchMeasures(
        bands=measures.bands(change),
        spectrum=measures.radial(change),
        noise=touch.noise,
        area=float(touch.touched.mean()),
        contrast=measures.contrast(change, touch.touched),
        inside=inside,
        outside=outside,
        ground=touch.background.mean(axis=(0, 1), dtype=np.float64),
        covariance=measures.covariance(change, touch.touched),
    )
