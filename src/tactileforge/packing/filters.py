"""Frame filters: sampling in time, and selection of frames that show something new.

AnyTouch 2 (appendix, statistics of the training data) computes "the variance of the Laplacian for
each frame relative to its preceding frame" and keeps what lies above a threshold. Clips are made of
neighbouring frames, so a frame alone is of no use: kept are all frames of all clips that hold a
lively frame, which are those within the length of a clip before or after one. What is left out
makes a gap in time, over which no clip is cut.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator, Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from tactileforge.data.labels.align import nearest

#: Rounding of times, s.
_ROUNDING = 1e-6
#: Steps of a clip of four frames.
_STEPS = 3

#: A frame's number in its recording, and the frame.
Numbered = tuple[int, NDArray[np.uint8]]


def sample_in_time(times: NDArray[np.float64], every: float | None) -> NDArray[np.int64]:
    """The frames nearest to each multiple of ``every`` seconds after the first; all if it is None.

    Example:
        >>> sample_in_time(np.arange(7) / 30, 1 / 15).tolist()
        [0, 2, 4, 6]
    """
    if every is None or len(times) < 2:
        return np.arange(len(times))
    ticks = np.arange(times[0], times[-1] + _ROUNDING, every)
    return np.unique(nearest(times, ticks))


def laplacian(frame: NDArray[np.uint8]) -> NDArray[np.int16]:
    """Laplacian of a frame's brightness, (H, W): four neighbours, mirrored at the borders."""
    out: NDArray[np.int16] = cv2.Laplacian(cv2.cvtColor(frame, cv2.COLOR_RGB2GRAY), cv2.CV_16S)
    return out


def laplacian_score(before: NDArray[np.int16], after: NDArray[np.int16]) -> float:
    """Variance of the Laplacian of the difference of two frames; 0 if nothing changes.

    Noise has a score as well, so what is lively depends on the sensor and on the codec of the
    source.

    Args:
        before: `laplacian` of one. That of a difference is the difference of the two.
        after: Of the other.
    """
    change = after - before
    mean = cv2.sumElems(change)[0] / change.size
    return max(0.0, float(cv2.norm(change, cv2.NORM_L2) ** 2 / change.size - mean**2))


def laplacian_scores(frames: Iterable[Numbered]) -> list[float]:
    """Score of each frame against the one before; the first has none (NaN)."""
    values: list[float] = []
    before = None
    for _, frame in frames:
        now = laplacian(frame)
        values.append(float("nan") if before is None else laplacian_score(before, now))
        before = now
    return values


def reach(times: NDArray[np.float64], span: float) -> float:
    """Seconds from the first frame of a clip of four to its last, as they are cut at this rate.

    Args:
        times: float64 (T,), s, strictly increasing.
        span: Wanted length of a clip, s.

    Example:
        >>> round(reach(np.arange(9) / 30, 0.2), 3), round(reach(np.arange(9) / 5, 0.2), 3)
        (0.2, 0.6)
    """
    if len(times) == 1:
        return 0.0
    period = float(np.median(np.diff(times)))
    return _STEPS * max(1, round(span / _STEPS / period)) * period


def peaks(times: NDArray[np.float64], scores: Sequence[float], span: float) -> NDArray[np.float64]:
    """Highest score within a clip's length of each frame: it is kept if that is high enough.

    Args:
        times: float64 (T,), s, ascending.
        scores: One a frame; NaN counts for nothing.
        span: Length of a clip, s, see `reach`.

    Returns:
        float64 (T,); infinite for a still, which has no frame before it and is kept.
    """
    if len(times) == 1:
        return np.full(1, np.inf)
    known = np.nan_to_num(np.asarray(scores, np.float64), nan=-np.inf)
    first = np.searchsorted(times, times - span - _ROUNDING)
    last = np.searchsorted(times, times + span + _ROUNDING)
    return np.array([known[i:j].max() for i, j in zip(first, last, strict=True)])


def only_lively(
    frames: Iterable[Numbered], times: NDArray[np.float64], threshold: float, span: float
) -> Iterator[Numbered]:
    """The frames whose `peaks` reach a threshold, as they come; ``span`` seconds are held.

    Args:
        frames: Ascending.
        times: float64, s, by the numbers of the frames.
        threshold: Frames are lively from this score on.
        span: Length of a clip, s, see `reach`.
    """
    waiting: deque[Numbered] = deque()
    before = None
    last = -np.inf
    for number, frame in frames:
        now, time = laplacian(frame), float(times[number])
        while waiting and time - times[waiting[0][0]] > span + _ROUNDING:
            waiting.popleft()
        if before is not None and laplacian_score(before, now) >= threshold:
            last = time
            yield from waiting
            waiting.clear()
        if time - last <= span + _ROUNDING:
            yield number, frame
        else:
            waiting.append((number, frame))
        before = now
