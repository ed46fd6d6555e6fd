"""Cuts videos into clips by time, as in training."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from itertools import islice
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from tactileforge.contracts import Frames
from tactileforge.data.frames.cut import clip_rows, clip_step, frame_period
from tactileforge.data.frames.lazy import ArrayFrames, VideoFrames
from tactileforge.data.frames.stacks import open_film
from tactileforge.data.frames.video_clock import video_times
from tactileforge.errors import ConfigError, DataError
from tactileforge.hub.inputs import read_still
from tactileforge.sensors.streaming.buffer import warn_of_slow_frames

Times = NDArray[np.float64]
#: A file, frames, or an array of them, uint8 (T, H, W, 3), RGB.
Video: TypeAlias = str | Path | Frames | NDArray[np.uint8]


def open_video(video: Video) -> Frames:
    """Opens a file or an array, uint8 (T, H, W, 3), as frames; passes frames through.

    Raises:
        DataError: The file is not a video, or the array is of another type or shape.
    """
    if isinstance(video, str | Path):
        return open_film(video)
    return ArrayFrames(video) if isinstance(video, np.ndarray) else video


def still_of(video: Frames, background: Any) -> Any:
    """The background of a video: its first frame for ``first``, which would be each clip's own.

    A path is read once, not with each batch.
    """
    if isinstance(background, str) and background == "first":
        return video.read([0])[0]
    return read_still(background)


def stacked(
    clips: Iterator[tuple[float, NDArray[np.uint8]]], size: int
) -> Iterator[tuple[list[float], NDArray[np.uint8]]]:
    """Times and clips, ``size`` at a time, uint8 (B, T, H, W, 3)."""
    while batch := list(islice(clips, size)):
        yield [end for end, _ in batch], np.stack([clip for _, clip in batch])


def along_video(
    video: Frames,
    clips: Iterator[tuple[float, NDArray[np.uint8]]],
    background: Any,
    size: int,
    read: Callable[[NDArray[np.uint8], Any], Tensor],
) -> tuple[Times, Tensor]:
    """Times and readings of a video's clips; only ``size`` clips are in memory at once.

    Args:
        video: The frames.
        clips: Its clips, see `cut_clips`.
        background: A frame, a path or a word, see `still_of`.
        size: Number of clips that are read at once.
        read: Reading of a batch of clips, (B, n), from its frames and their background.
    """
    still = still_of(video, background)
    ends: list[float] = []
    found: list[Tensor] = []
    for some, batch in stacked(clips, size):
        ends += some
        found.append(read(batch, still))
    return np.array(ends), torch.cat(found)


def cut_clips(
    video: Frames, frames: int, spacing: float, hop: float, times: Times | None
) -> Iterator[tuple[float, NDArray[np.uint8]]]:
    """Clips of a video, one read at a time, cut by the time of each frame.

    A clip that would reach over a gap in the video is left out. Warns where frames come too seldom
    for the spacing.

    Args:
        video: Frames; those of a file know their times.
        frames: Frames of a clip.
        spacing: Seconds between them, rounded to whole periods of the video.
        hop: Seconds between the ends of neighbouring clips; at least one frame.
        times: float64, seconds of each frame, increasing; None takes the video's own.

    Yields:
        The time of a clip's last frame, s, and its frames, uint8 (T, H, W, 3).

    Raises:
        ConfigError: No times for frames that know none, or a hop that is not a number above 0.
        DataError: The video is too short for one clip, or its times do not go forward.
    """
    if not (math.isfinite(hop) and hop > 0):
        raise ConfigError(f"hop={hop}: give the seconds between clips, above 0")
    seconds = _times(video, times)
    # one frame has no period, and any will do
    period = frame_period(seconds) if len(seconds) > 1 else 1.0
    warn_of_slow_frames(period, spacing, frames, stacklevel=4)
    due = -math.inf
    for end, now in enumerate(seconds):
        if now < due:
            continue
        # of the frames within reach alone: the search does not grow with the video
        first = int(np.searchsorted(seconds, now - frames * clip_step(period, spacing)))
        rows = clip_rows(seconds[first : end + 1], frames, spacing, period)
        if rows is None:
            continue
        # half a frame early: times of frames waver, and a hop would end at the next one
        due = now + hop - period / 2
        yield float(now), video.read([first + row for row in rows])
    if due == -math.inf:
        span = (frames - 1) * round(clip_step(period, spacing) / period) + 1
        raise DataError(
            f"{len(seconds)} frames, {period:.3g} s apart: a clip of {frames}, {spacing:.3g} s "
            f"apart, spans {span}; give a longer video, or load the model with fewer frames"
        )


def _times(video: Frames, times: Times | None) -> Times:
    """Seconds of each frame: finite, and each after the one before."""
    given = getattr(video, "times", None) if times is None else times
    if times is None and isinstance(video, VideoFrames):
        given = video_times(video, "give the seconds of each frame: times=")
    if given is None or len(given) != len(video):
        raise ConfigError(
            f"times: give the seconds of each of the {len(video)} frames; only files know their own"
        )
    seconds = np.asarray(given, np.float64)
    wrong = ~np.isfinite(seconds)
    # not (x > 0), and not x <= 0: NaN is neither
    wrong[1:] |= ~(np.diff(seconds) > 0)
    if wrong.any():
        row = int(wrong.argmax())
        before = f" after {seconds[row - 1]:g} s" if row else ""
        raise DataError(
            f"times: frame {row} is at {seconds[row]:g} s{before}: times go forward; sort the "
            "frames, or give each recording by itself"
        )
    return seconds
