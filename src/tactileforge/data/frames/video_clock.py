"""Times of a video, where its header and its time stamps can be believed."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tactileforge.data.frames.video import VideoFrames
from tactileforge.errors import DataError

#: Frames a second beyond which no camera of touch is: what says so has another rate.
FASTEST = 300.0
#: Frames a second below which a header says nothing of a camera: one an hour.
_SLOWEST = 1 / 3600
#: How many times the rate of the header may be that of the time stamps.
_APART = 1.5
#: Share by which steps of time may vary to have a rate at all.
_STEADY = 0.2


def video_times(video: VideoFrames, fix: str) -> NDArray[np.float64]:
    """The times of the frames of a video, s.

    Args:
        video: The video.
        fix: A way to give another rate, for messages.

    Raises:
        DataError: The file says a rate that no camera has.
    """
    times = video.times
    if len(times) < 2:
        return times
    rate = 1 / max(float(np.median(np.diff(times))), 1e-9)
    if not _SLOWEST <= rate <= FASTEST:
        raise DataError(
            f"{video.path}: by its time stamps, it has {rate:.4g} frames a second (its header says "
            f"{video.rate:.4g}), which no camera of touch has; {fix}"
        )
    return times


def rate_doubt(video: VideoFrames) -> str:
    """Difference of the rates of header and time stamps, in words; "" where there is none."""
    steps = np.diff(video.times)
    if len(steps) < 2 or not video.rate > 0:
        return ""
    low, usual, high = np.quantile(steps, [0.1, 0.5, 0.9])
    if usual <= 0 or high - low > _STEADY * usual:
        return ""
    stamps, mean = 1 / usual, len(video.times) / (video.times[-1] + usual)
    said = [rate for rate in (stamps, mean) if 1 / _APART <= video.rate / rate <= _APART]
    if said:  # many headers say the mean, which gaps make smaller
        return ""
    return (
        f"its header says {video.rate:.4g} frames a second, its time stamps {stamps:.4g}; the "
        "stamps count: give fps: if the header is right"
    )
