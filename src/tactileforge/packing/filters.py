"""Frame filters: sampling in time, and selection of frames with change.

AnyTouch 2 (appendix, statistics of the training data) computes "the variance of the Laplacian for
each frame relative to its preceding frame" and keeps frames above a threshold. Clips are made of
neighbouring frames, so a single frame is useless: all frames of all clips with a lively frame are
kept, those within the length of a clip before or after it. The others leave a gap in time, and no
clip is cut across it.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator, Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from tactileforge.data.labels.align import nearest

#: Tolerance for rounding of times, s: a frame at the very end of a clip is within it.
_ROUNDING = 1e-6
#: Steps of a clip of four frames, as in AnyTouch 2.
_STEPS = 3

#: A frame's number in its recording, and the frame.
Numbered = tuple[int, NDArray[np.uint8]]


def sample_in_time(times: NDArray[np.float64], every: float | None) -> NDArray[np.int64]:
    """Numbers of the frames nearest to multiples of ``every`` seconds; None takes all.

    Example:
        >>> sample_in_time(np.arange(7) / 30, 1 / 15).tolist()
        [0, 2, 4, 6]
    """
    if every is None or len(times) < 2:
        return np.arange(len(times))
    ticks = np.arange(times[0], times[-1] + _ROUNDING, every)
    # at a low rate, two ticks may have one nearest frame
    return np.unique(nearest(times, ticks))


def laplacian(frame: NDArray[np.uint8]) -> NDArray[np.int16]:
    """Laplacian of a frame's brightness, int16 (H, W): four neighbours, mirrored at the borders."""
    out: NDArray[np.int16] = cv2.Laplacian(cv2.cvtColor(frame, cv2.COLOR_RGB2GRAY), cv2.CV_16S)
    return out


def laplacian_score(before: NDArray[np.int16], after: NDArray[np.int16]) -> float:
    """Variance of the Laplacian of the difference of two frames; 0 without change.

    Noise has a score as well, so a threshold depends on the sensor and on the codec of the source.

    Args:
        before: `laplacian` of the earlier frame.
        after: `laplacian` of the later frame.
    """
    # the Laplacian is linear: of a difference, it is the difference of the two
    change = after - before
    # mean of squares less square of the mean, by OpenCV: several times as fast as numpy on int16
    mean = cv2.sumElems(change)[0] / change.size
    return max(0.0, float(cv2.norm(change, cv2.NORM_L2) ** 2 / change.size - mean**2))


def laplacian_scores(frames: Iterable[Numbered]) -> list[float]:
    """Score of each frame against its predecessor; NaN for the first."""
    values: list[float] = []
    before = None
    for _, frame in frames:
        now = laplacian(frame)
        values.append(float("nan") if before is None else laplacian_score(before, now))
        before = now
    return values


def reach(times: NDArray[np.float64], span: float) -> float:
    """Actual length of a clip of four frames at the rate of a recording, s.

    Args:
        times: float64 (T,), s, strictly increasing.
        span: Nominal length of a clip, s.

    Example:
        >>> round(reach(np.arange(9) / 30, 0.2), 3), round(reach(np.arange(9) / 5, 0.2), 3)
        (0.2, 0.6)
    """
    if len(times) == 1:
        return 0.0
    period = float(np.median(np.diff(times)))
    return _STEPS * max(1, round(span / _STEPS / period)) * period


def peaks(times: NDArray[np.float64], scores: Sequence[float], span: float) -> NDArray[np.float64]:
    """Highest score within a clip's length of each frame, to compare with a threshold.

    Args:
        times: float64 (T,), s, ascending.
        scores: Score of each frame; NaN is ignored.
        span: Length of a clip, s, see `reach`.

    Returns:
        float64 (T,); infinite for a still: it has no predecessor, and is kept.
    """
    if len(times) == 1:
        return np.full(1, np.inf)
    known = np.nan_to_num(np.asarray(scores, np.float64), nan=-np.inf)
    first = np.searchsorted(times, times - span - _ROUNDING)
    last = np.searchsorted(times, times + span + _ROUNDING)
    return np.array([known[i:j].max() for i, j in zip(first, last, strict=True)])


def select_lively(
    frames: Iterable[Numbered], times: NDArray[np.float64], threshold: float, span: float
) -> Iterator[Numbered]:
    """Yield frames with `peaks` at or above a threshold; buffers ``span`` seconds.

    Args:
        frames: Frames by ascending number.
        times: float64 (T,), s, by number of frame.
        threshold: Smallest score of a lively frame.
        span: Length of a clip, s, see `reach`.
    """
    waiting: deque[Numbered] = deque()
    before = None
    last = -np.inf
    for number, frame in frames:
        now, time = laplacian(frame), float(times[number])
        # frames wait until a lively one comes within reach, and are dropped when none can
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
