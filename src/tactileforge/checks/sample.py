"""A few frames of a recording, made small, with what is measured on them."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from tactileforge.checks.frozen import digest_of, frozen_time
from tactileforge.contracts import Frames, FrameSubset, Recording
from tactileforge.data.frames.crop import check_background_size
from tactileforge.data.frames.cut import spread_rows
from tactileforge.data.frames.pixel_contract import checked_chunks
from tactileforge.data.frames.small import ELSEWHERE, shrink, strongest
from tactileforge.data.frames.turned import TurnedFrames
from tactileforge.errors import DataError

#: Frames of a recording to decode, frames of a signature, and frames of the background for its
#: median.
FRAMES, SIGNED, _BACKGROUND = 24, 8, 15
#: Frames in memory at once: 8 of 640 x 480 pixels are 7 MB, as they come from the decoder.
CHUNK = 8
#: Height and width of the images for comparison, pixels: all recordings are held in memory.
_SIGNATURE = (24, 32)
#: Frames of a stretch whose neighbours are compared.
STRETCH = 64
#: Frames at each end that tell how far the light drifted.
_ENDS = 5
#: Step of the pixels that are compared in neighbours, in both directions.
_STEP = 4


@dataclass(frozen=True)
class FrameSample:
    """Some frames of a recording, made small, and their statistics.

    Differences are absolute, from the background or else from the median of the frames; in grey
    levels of 255, the mean of the three channels.

    Attributes:
        rows: int64 (n,), frame numbers, evenly spread.
        shape: Height and width of a frame, pixels.
        frames: float32 (n, h, w, 3), small frames.
        background: float32 (h, w, 3), small median of the frames without contact; None without any.
        still: The background, or else the median of the frames.
        own: Numbers of frames of the recording that are its background; empty for frames of a file.
        change: float64 (n,), mean difference of each frame.
        contact: Smoothed difference of the strongest 1 % of the image in the frame of largest
            change.
        ground: Median difference in the frame of smallest change.
        others: The same of three quarters of the frames that are not the background, at least.
        saturated: Share of pixels with a channel at 0 or 255, in the worst frame.
        white: The same at 255 alone.
        frozen: Longest run of identical frames around those decoded, s.
        digest: Hash of the pixels of all decoded frames.
        signature: int16 (8, 24, 32, 3), tiny frames for comparison.
        imprint: Difference of the tiny frames from the picture at rest, in all but 0.5 % of them.
    """

    rows: NDArray[np.int64]
    shape: tuple[int, int]
    frames: NDArray[np.float32]
    background: NDArray[np.float32] | None
    still: NDArray[np.float32]
    own: tuple[int, ...]
    change: NDArray[np.float64]
    contact: float
    ground: float
    others: float
    saturated: float
    white: float
    frozen: float
    digest: bytes
    signature: NDArray[np.int16]
    imprint: float


def sample_of(recording: Recording) -> FrameSample:
    """Decode at most `FRAMES` frames, each with the next, and the background.

    Args:
        recording: The recording.

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
    small, saturated, white, digests = [], 0.0, 0.0, []
    for chunk in checked_chunks(recording.frames, rows.tolist(), "frames", CHUNK):
        for frame in chunk:
            # before it is made small: an average hides single pixels
            ends = ((frame == 0) | (frame == 255)).any(axis=-1)
            saturated = max(saturated, share := float(ends.mean()))
            if share > white:
                white = max(white, float((frame == 255).any(axis=-1).mean()))
            digests.append(digest_of(frame))
            small.append(shrink(frame))
    frames = np.stack(small)
    # the median of the frames is the picture without contact if contact moves or is rare
    still = np.median(frames, axis=0) if background is None else background
    away = np.abs(frames - still).mean(axis=-1)
    change = away.mean(axis=(1, 2))
    own = own_rows(recording)
    # a frame of the background is like it even where that is another picture altogether
    others = [i for i, row in enumerate(rows.tolist()) if row not in own] or [*range(len(rows))]
    most, least = int(change.argmax()), int(change.argmin())
    # not of the least alone, as more of the first frames may be odd than those of the background
    grounds = np.median(away[others].reshape(len(others), -1), axis=1)
    signature = _signature(frames[evenly(len(rows), SIGNED)])
    imprint = np.quantile(np.abs(signature - _signature(still[None])[:1]), 1 - ELSEWHERE)
    return FrameSample(
        rows=rows,
        shape=recording.frames.shape,
        frames=frames,
        background=background,
        still=still,
        own=own,
        change=change.astype(np.float64),
        # in the frame of largest change, as a touch is short; the ground in that of smallest, which
        # shows no contact if any does
        contact=strongest(frames[most] - still),
        ground=float(np.median(away[least])),
        others=float(np.quantile(grounds, 0.25)),
        saturated=saturated,
        white=white,
        frozen=frozen_time(recording, rows.tolist(), digests),
        digest=hashlib.blake2b(b"".join(digests), digest_size=16).digest(),
        signature=signature,
        imprint=float(imprint),
    )


def own_rows(recording: Recording) -> tuple[int, ...]:
    """Numbers of frames of a recording that are its background; empty for frames of a file."""
    still, frames = recording.no_contact, recording.frames
    if not isinstance(still, FrameSubset):
        return ()
    if isinstance(frames, FrameSubset) and _file_of(frames.base) is _file_of(still.base):
        places = {int(row): place for place, row in enumerate(frames.rows)}
        return tuple(places[int(row)] for row in still.rows if int(row) in places)
    same = _file_of(still.base) is _file_of(frames)
    return tuple(int(row) for row in still.rows) if same else ()


def _file_of(frames: Frames) -> Frames:
    """Frames as they are in their file, without turns."""
    while isinstance(frames, TurnedFrames):
        frames = frames.base
    return frames


def neighbour_changes(recording: Recording, row: int, count: int = STRETCH) -> NDArray[np.float64]:
    """Mean change from each frame to the next in a stretch, grey levels, float64 (n - 1,).

    Args:
        recording: The recording.
        row: Frame in the middle of the stretch.
        count: Frames of the stretch.

    Raises:
        DataError: A frame cannot be decoded.
    """
    length = len(recording.frames)
    start = min(max(0, row - count // 2), max(0, length - count))
    rows = range(start, min(length, start + count))
    changes, last = [], None
    for at in range(0, len(rows), CHUNK):
        for frame in recording.frames.read(rows[at : at + CHUNK]):
            seen = frame[::_STEP, ::_STEP].astype(np.int16)
            if last is not None:
                changes.append(float(np.abs(seen - last).mean()))
            last = seen
    return np.array(changes, np.float64)


def changes(recording: Recording, rows: Sequence[int]) -> NDArray[np.float64]:
    """Mean difference of frames from the background, or else from the first of them, float64 (n,).

    Light that drifts is no touch: left out is a line over time of each colour's median change,
    through the first and the last frames.

    Args:
        recording: The recording.
        rows: Frame numbers.

    Raises:
        DataError: A frame cannot be decoded.
    """
    still = background_of(recording)
    differences = []
    for chunk in checked_chunks(recording.frames, rows, "frames", CHUNK):
        for frame in chunk:
            small = shrink(frame)
            still = small if still is None else still
            differences.append(small - still)
    if not differences:
        return np.zeros(0)
    change = np.stack(differences)
    median = np.median(change, axis=(1, 2))
    ends = median[:_ENDS].mean(axis=0), median[-_ENDS:].mean(axis=0)
    share = np.linspace(0, 1, len(change))[:, None]
    drift = ends[0] + share * (ends[1] - ends[0])
    size = np.abs(change - drift[:, None, None]).mean(axis=(1, 2, 3))
    return np.asarray(size, np.float64)


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
    chunks = checked_chunks(still, rows, "frames", CHUNK)
    small = [shrink(frame) for chunk in chunks for frame in chunk]
    return np.median(small, axis=0).astype(np.float32)


def evenly(length: int, count: int) -> NDArray[np.int64]:
    """At most ``count`` different numbers spread evenly over ``0..length - 1``, with both ends."""
    return np.array(spread_rows(length, count), np.int64)


def _signature(frames: NDArray[np.float32]) -> NDArray[np.int16]:
    size = _SIGNATURE[::-1]
    # in colours: lights of three sides cancel in their mean, and faint imprints with them
    small = [cv2.resize(frame, size, interpolation=cv2.INTER_AREA) for frame in frames]
    # always as many, some of them twice in a short recording: signatures are compared one by one
    rows = np.linspace(0, len(small) - 1, SIGNED).round().astype(int)
    out: NDArray[np.int16] = np.round(small).astype(np.int16)[rows]
    return out
