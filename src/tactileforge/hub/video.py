"""Cuts videos into clips by time, as in training."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tactileforge.contracts import Frames
from tactileforge.errors import ConfigError, DataError

Times = NDArray[np.float64]


def open_video(video: str | Path | Frames) -> Frames:
    """Opens a file as lazy frames; passes frames through."""
    if isinstance(video, str | Path):
        from tactileforge.data.frames.video import VideoFrames

        return VideoFrames(video)
    return video


def cut_clips(
    video: Frames, frames: int, spacing: float, hop: float, times: Times | None
) -> Iterator[tuple[float, NDArray[np.uint8]]]:
    """Clips of a video, one read at a time.

    Args:
        video: Frames; those of a file know their times.
        frames: Frames of a clip.
        spacing: Seconds between them, rounded to whole frames of the video.
        hop: Seconds between the ends of neighbouring clips; at least one frame.
        times: float64, seconds of each frame, increasing; None takes the video's own.

    Yields:
        The time of a clip's last frame, s, and its frames, uint8 (T, H, W, 3).

    Raises:
        ConfigError: No times for frames that know none.
        DataError: The video is too short for one clip.
    """
    seconds: Times | None = getattr(video, "times", None) if times is None else times
    if seconds is None or len(seconds) != len(video):
        raise ConfigError(
            f"times: give the seconds of each of the {len(video)} frames; only files know their own"
        )
    period = float(np.median(np.diff(seconds))) if len(seconds) > 1 else 1.0
    stride = max(1, round(spacing / period))
    span = (frames - 1) * stride
    if span >= len(seconds):
        raise DataError(
            f"{len(seconds)} frames, {period:.3g} s apart: a clip of {frames}, {spacing:.3g} s "
            f"apart, spans {span + 1}; give a longer video, or load the model with fewer frames"
        )
    for end in range(span, len(seconds), max(1, round(hop / period))):
        yield float(seconds[end]), video.read(range(end - span, end + 1, stride))
