"""Times of a video, checked for plausible rates in header and time stamps."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tactileforge.data.frames.video import VideoFrames
from tactileforge.errors import DataError

#: Largest plausible rate of a tactile camera, frames a second.
FASTEST_RATE = 300.0
#: Smallest plausible rate, frames a second: one an hour.
_SLOWEST = 1 / 3600
#: Largest plausible ratio of the rates of header and time stamps.
_APART = 1.5
#: Largest relative variation of steps of time that still have one rate.
_STEADY = 0.2


def video_times(video: VideoFrames, fix: str) -> NDArray[np.float64]:
    """Times of the frames of a video, float64 (T,), s.

    Args:
        video: The video.
        fix: A way to give another rate, for messages.

    Raises:
        DataError: Implausible rate.
    """
    times = video.times
    if len(times) < 2:
        return times
    rate = 1 / max(float(np.median(np.diff(times))), 1e-9)
    if not _SLOWEST <= rate <= FASTEST_RATE:
        raise DataError(
            f"{video.path}: by its time stamps, it has {rate:.4g} frames a second (its header says "
            f"{video.rate:.4g}), which no camera of touch has; {fix}"
        )
    return times


def rate_doubt(video: VideoFrames) -> str:
    """Difference of the rates of header and time stamps, in words; "" for none."""
    steps = np.diff(video.times)
    if len(steps) < 2 or not video.rate > 0:
        return ""
    low, usual, high = np.quantile(steps, [0.1, 0.5, 0.9])
    if usual <= 0 or high - low > _STEADY * usual:
        return ""
    stamps, mean = 1 / usual, len(video.times) / (video.times[-1] + usual)
    # many headers state the mean rate, which gaps make smaller
    if any(1 / _APART <= video.rate / rate <= _APART for rate in (stamps, mean)):
        return ""
    return (
        f"its header says {video.rate:.4g} frames a second, its time stamps {stamps:.4g}; the "
        "stamps count: give fps: if the header is right"
    )
