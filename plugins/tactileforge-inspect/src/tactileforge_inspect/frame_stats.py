"""Statistics of a recording from a few frames, made small."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tactileforge.checks import FrameSample, evenly, sample_of
from tactileforge.contracts import Recording
from tactileforge.pages import amplified_difference

#: Frames of a strip.
STRIP = 8
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
        signature: int16 (STRIP, 24, 32, 3), tiny frames for comparison.
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


def frame_stats(
    recording: Recording, strip: bool = False, sample: FrameSample | None = None
) -> FrameStats:
    """Decode at most 24 frames, each with the next, and the background.

    Args:
        recording: The recording.
        strip: Whether to keep frames over time.
        sample: Frames that were decoded already; None decodes them.

    Raises:
        DataError: A frame cannot be decoded, the numbers of times and frames differ, or the
            background has another size.
    """
    seen = sample or sample_of(recording)
    frames, still = seen.frames, seen.still
    most = int(seen.change.argmax())
    shown = evenly(len(seen.rows), STRIP)
    has_background = seen.background is not None
    return FrameStats(
        rows=seen.rows,
        shape=seen.shape,
        change=seen.change,
        contact=seen.contact,
        ground=seen.ground,
        saturated=seen.saturated,
        frozen=seen.frozen,
        digest=seen.digest,
        signature=seen.signature,
        frame=frames[most].round().astype(np.uint8),
        difference=amplify(frames[most] - still) if has_background else None,
        strip=frames[shown].round().astype(np.uint8) if strip else _NOTHING,
        strip_difference=amplify(frames[shown] - still) if strip and has_background else _NOTHING,
        strip_rows=seen.rows[shown].tolist(),
        still=still,
    )


def amplify(difference: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Show a difference as an image around mid-grey; the strongest 0.5 % is clipped."""
    # at least 8 levels to full scale: the noise of a recording without contact stays grey
    gain = 127 / max(float(np.quantile(np.abs(difference), 0.995)), 8.0)
    return amplified_difference(difference, gain)
