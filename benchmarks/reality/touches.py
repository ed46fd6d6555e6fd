"""A recording as one touch: without contact, and at its strongest."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from reality import measures
from reality.measures import Array
from tactileforge.contracts import Recording
from tactileforge.data.frames.crop import size_text
from tactileforge.errors import DataError
from tactileforge.inspection.frame_stats import evenly

#: Frames of a part of a recording in which the strongest contact is looked for.
_FRAMES = 24
#: Frames without contact that are read.
_STILL = 15
#: A recording counts as a touch for each so many frames, but not as more than so many.
_LONG, _MOST = 64, 8


@dataclass(frozen=True)
class StrongestTouch:
    """A recording at its strongest contact.

    Attributes:
        key: Of the recording.
        sensor: Its type.
        background: float32 (H, W, 3), grey levels, at most `measures.SIDE` on the shorter side.
        picture: float32 (H, W, 3), the frame that differs most from it.
        touched: bool (H, W), its contact; nowhere if the touch is faint.
        noise: Deviation of a pixel over time, grey levels; NaN where that cannot be told.
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
        recording: Long ones have several parts, of at least 64 frames each.
        most: Parts, at most.

    Returns:
        Touches; none where the recording has no image without contact.

    Raises:
        DataError: A frame cannot be decoded, or the background has another size than the frames.
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
    """The frame that differs most from the background, of some of a part of a recording."""
    rows = part[evenly(len(part), _FRAMES)].tolist()
    frames = recording.frames.read(rows)
    away = [float(np.abs(frame - background).mean()) for frame in frames]
    return measures.sized(frames[int(np.argmax(away))])


@dataclass(frozen=True)
class TouchMeasures:
    """The numbers of one touch, see `measures`.

    Attributes:
        bands: float64 (4,), decades.
        spectrum: float64 (40,), power density in rings, squared grey levels.
        noise: Grey levels.
        area: Share of the image that is touched.
        contrast: Grey levels.
        inside: Fine detail in the contact, grey levels.
        outside: Fine detail far from it.
        ground: float64 (3,), mean of each channel of the background, grey levels.
        covariance: float64 (3, 3), of the channels' changes.
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
    """Measures a touch; None where it is too faint."""
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
