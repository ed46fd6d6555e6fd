"""Statistics of a recording from a few frames, made small."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from tactileforge.contracts import Recording
from tactileforge.data import check_background_size, checked_chunks, shrink, spread_rows, strongest
from tactileforge.errors import DataError
from tactileforge.pages import amplified_difference
from tactileforge_inspect.frozen import digest_of, frozen_time

#: Frames of a recording to decode, and frames of a strip.
FRAMES = 24
STRIP = 8
#: Frames of the background for its median.
_BACKGROUND = 15
#: Frames in memory at once: 8 of 640 x 480 pixels are 7 MB, as they come from the decoder.
_CHUNK = 8
#: Height and width of the images for comparison, pixels: all recordings are held in memory.
_SIGNATURE = (24, 32)
_NOTHING = np.empty((0, 1, 1, 3), np.uint8)


@dataclass(frozen=True)
class FrameStats:
    """Some frames of a recording, made small, and their statistics.

    Differences are absolute, from the background or else from the median of the frames; in grey
    levels of 255, the mean of the three channels.

    Attributes:
        rows: int64 (n,), frame numbers, evenly spread.
        shape: Height and width of a frame, pixels.
        change: float64 (n,), mean difference of each frame.
        contact: Smoothed difference of the strongest 1 % of the image in the frame of largest
            change.
        ground: Median difference in the frame of smallest change.
        saturated: Share of pixels with a channel at 0 or 255, in the worst frame.
        frozen: Longest run of identical frames around those decoded, s.
        digest: Hash of the pixels of all decoded frames.
        signature: int16 (STRIP, 24, 32), grey frames for comparison.
        frame: uint8 (h, w, 3), small frame of largest change.
        difference: uint8 (h, w, 3), amplified difference of that frame from the background, around
            mid-grey; None without background.
        strip: uint8 (STRIP or fewer, h, w, 3), frames over time; empty by default.
        strip_difference: Amplified differences of the strip; empty without background.
        strip_rows: Frame numbers of the strip.
        still: float32 (h, w, 3), the picture without contact, or else the median of the frames.
    """

    rows: NDArray[np.int64]
    shape: tuple[int, int]
    change: NDArray[np.float64]
    contact: float
    ground: float
    saturated: float
    frozen: float
    digest: bytes
    signature: NDArray[np.int16]
    frame: NDArray[np.uint8]
    difference: NDArray[np.uint8] | None
    strip: NDArray[np.uint8]
    strip_difference: NDArray[np.uint8]
    strip_rows: list[int]
    still: NDArray[np.float32]


def frame_stats(recording: Recording, strip: bool = False) -> FrameStats:
    """Decode at most `FRAMES` frames, each with the next, and the background.

    Args:
        recording: The recording.
        strip: Whether to keep frames over time.

    Raises:
        DataError: A frame cannot be decoded, the numbers of times and frames differ, or the
            background has another size.
    """
    if len(recording.times) != len(recording.frames):
        raise DataError(
            f"{recording.key}: {len(recording.times)} times for {len(recording.frames)} frames"
        )
    background = background_of(recording)
    rows = evenly(len(recording.frames), FRAMES)
    small, saturated, digests = [], 0.0, []
    for chunk in checked_chunks(recording.frames, rows.tolist(), "frames", _CHUNK):
        for frame in chunk:
            # before it is made small: an average hides single pixels
            ends = ((frame == 0) | (frame == 255)).any(axis=-1)
            saturated = max(saturated, float(ends.mean()))
            digests.append(digest_of(frame))
            small.append(shrink(frame))
    frames = np.stack(small)
    # the median of the frames is the picture without contact if contact moves or is rare
    still = np.median(frames, axis=0) if background is None else background
    away = np.abs(frames - still).mean(axis=-1)
    change = away.mean(axis=(1, 2))
    most, least = int(change.argmax()), int(change.argmin())
    shown = evenly(len(rows), STRIP)
    return FrameStats(
        rows=rows,
        shape=recording.frames.shape,
        change=change.astype(np.float64),
        # in the frame of largest change, as a touch is short; the ground in that of smallest, which
        # shows no contact if any does
        contact=strongest(frames[most] - still),
        ground=float(np.median(away[least])),
        saturated=saturated,
        frozen=frozen_time(recording, rows.tolist(), digests),
        digest=hashlib.blake2b(b"".join(digests), digest_size=16).digest(),
        signature=_signature(frames[shown]),
        frame=frames[most].round().astype(np.uint8),
        difference=None if background is None else amplify(frames[most] - still),
        strip=frames[shown].round().astype(np.uint8) if strip else _NOTHING,
        strip_difference=amplify(frames[shown] - still)
        if strip and background is not None
        else _NOTHING,
        strip_rows=rows[shown].tolist(),
        still=still,
    )


def changes(recording: Recording, rows: Sequence[int]) -> NDArray[np.float64]:
    """Mean difference of frames from the background, or else from the first of them, float64 (n,).

    Args:
        recording: The recording.
        rows: Frame numbers.

    Raises:
        DataError: A frame cannot be decoded.
    """
    still = background_of(recording)
    differences = []
    for chunk in checked_chunks(recording.frames, rows, "frames", _CHUNK):
        for frame in chunk:
            small = shrink(frame)
            still = small if still is None else still
            differences.append(float(np.abs(small - still).mean()))
    return np.array(differences)


def background_of(recording: Recording) -> NDArray[np.float32] | None:
    """Small background, float32 (h, w, 3); None without one.

    Raises:
        DataError: The background cannot be decoded, or its size is not that of the frames.
    """
    still = recording.no_contact
    if still is None:
        return None
    check_background_size(still.shape, recording.frames.shape, recording.key)
    rows = evenly(len(still), _BACKGROUND).tolist()
    chunks = checked_chunks(still, rows, "frames", _CHUNK)
    small = [shrink(frame) for chunk in chunks for frame in chunk]
    return np.median(small, axis=0).astype(np.float32)


def evenly(length: int, count: int) -> NDArray[np.int64]:
    """At most ``count`` different numbers spread evenly over ``0..length - 1``, with both ends."""
    return np.array(spread_rows(length, count), np.int64)


def amplify(difference: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Show a difference as an image around mid-grey; the strongest 0.5 % is clipped."""
    # at least 8 levels to full scale: the noise of a recording without contact stays grey
    gain = 127 / max(float(np.quantile(np.abs(difference), 0.995)), 8.0)
    return amplified_difference(difference, gain)


def _signature(frames: NDArray[np.float32]) -> NDArray[np.int16]:
    size = _SIGNATURE[::-1]
    grey = [cv2.resize(frame.mean(-1), size, interpolation=cv2.INTER_AREA) for frame in frames]
    # always as many, some of them twice in a short recording: signatures are compared one by one
    rows = np.linspace(0, len(grey) - 1, STRIP).round().astype(int)
    out: NDArray[np.int16] = np.round(grey).astype(np.int16)[rows]
    return out
