"""Cutting of clips by time: one rule for training, videos, calibration and live sensors."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from tactileforge.data.labels.align import nearest

#: Largest ratio of the actual spacing to the requested one without a warning. Rounding to whole
#: periods is off by a third at most: at 1.5 periods, the worst case, 2 are taken.
_STRETCH = 4 / 3


def spread_rows(count: int, most: int) -> list[int]:
    """At most ``most`` different rows, spread evenly over ``count`` of them, both ends among them.

    Example:
        >>> spread_rows(10, 4), spread_rows(2, 4)
        ([0, 3, 6, 9], [0, 1])
    """
    rows = np.linspace(0, count - 1, min(count, most)).round().astype(np.int64)
    return [int(row) for row in np.unique(rows)]


def frame_period(times: NDArray[np.float64]) -> float:
    """Seconds between frames: the median, robust against lost and late frames.

    Of an even number of steps, the lower of the two in the middle: their mean may be the period of
    no frame.

    Args:
        times: float64 (n,), seconds; at least two.
    """
    return float(np.quantile(np.diff(times), 0.5, method="lower"))


def clip_step(period: float, spacing: float) -> float:
    """Seconds between the frames of a clip: the whole number of periods nearest to the spacing.

    Example:
        >>> clip_step(0.03, 0.0667)
        0.06
    """
    return max(1, round(spacing / period)) * period


def is_slow(period: float, spacing: float, frames: int) -> bool:
    """Whether the frame rate is too low for the spacing of clips.

    Args:
        period: Seconds between frames of the camera.
        spacing: Seconds between the frames of a clip.
        frames: Frames of a clip.

    Example:
        >>> is_slow(0.5, 0.0667, 4), is_slow(0.0333, 0.0667, 4)
        (True, False)
    """
    return frames > 1 and period > 0 and clip_step(period, spacing) > _STRETCH * spacing + 1e-9


def held_clips(
    times: NDArray[np.float64],
    ends: Sequence[int] | NDArray[np.int64],
    frames: int,
    spacing: float,
    period: float | None = None,
) -> NDArray[np.int64]:
    """Rows of clips with given last frames, int64 (N, T), oldest first.

    Each row is the frame nearest in time, so that the rate may vary. Before the first frame and
    in a gap, a frame is repeated.

    Args:
        times: float64 (n,), seconds, increasing.
        ends: Last row of each clip, int64 (N,).
        frames: Frames of a clip, T.
        spacing: Seconds between the frames of a clip.
        period: Seconds between the frames of the camera; None takes the median of ``times``.

    Example:
        >>> held_clips(np.arange(8) / 30, [1, 7], 4, 1 / 15).tolist()
        [[0, 0, 0, 1], [1, 3, 5, 7]]
    """
    last = np.asarray(ends, np.int64)
    if frames == 1 or len(times) == 1:
        return np.repeat(last[:, None], frames, axis=1)
    period = frame_period(times) if period is None else period
    due = _due_times(times[last], frames, clip_step(period, spacing))
    return nearest(times, due.ravel()).reshape(due.shape)


def whole_clips(
    times: NDArray[np.float64], rows: NDArray[np.int64], spacing: float, period: float | None = None
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Check clips for their full length and for gaps; bool (N,) both.

    One lost frame is replaced by its neighbour; more are a gap.

    Args:
        times: float64 (n,), seconds, increasing.
        rows: Result of `held_clips`, int64 (N, T).
        spacing: Seconds between the frames of a clip.
        period: Seconds between the frames of the camera; None takes the median of ``times``.
    """
    frames = rows.shape[1]
    if frames == 1:
        return np.ones(len(rows), np.bool_), np.ones(len(rows), np.bool_)
    if len(times) == 1:
        return np.zeros(len(rows), np.bool_), np.ones(len(rows), np.bool_)
    period = frame_period(times) if period is None else period
    step = clip_step(period, spacing)
    due = _due_times(times[rows[:, -1]], frames, step)
    away = np.abs(times[rows] - due.clip(min=times[0]))
    # half a period and a hundredth of a step leave room for the jitter of time stamps
    return due[:, 0] >= times[0] - period / 2, away.max(axis=1) <= 1.01 * step


def clip_rows(
    times: NDArray[np.float64], frames: int, spacing: float, period: float | None = None
) -> list[int] | None:
    """Rows of the clip of the last frame.

    Args:
        times: float64 (n,), seconds, increasing.
        frames: Frames of the clip.
        spacing: Seconds between the frames of the clip.
        period: Seconds between the frames of the camera; None takes the median of ``times``.

    Returns:
        Rows, oldest first; None for too few frames, or a gap.

    Example:
        >>> clip_rows(np.arange(8) / 30, 4, 1 / 15)
        [1, 3, 5, 7]
        >>> clip_rows(np.arange(8) / 18, 4, 1 / 15)
        [4, 5, 6, 7]
    """
    rows = held_clips(times, [len(times) - 1], frames, spacing, period)
    reaches, together = whole_clips(times, rows, spacing, period)
    found: list[int] = rows[0].tolist()
    return found if reaches[0] and together[0] else None


def _due_times(ends: NDArray[np.float64], frames: int, step: float) -> NDArray[np.float64]:
    """Ideal times of the frames of clips, by the times of their last frames, (N, T)."""
    due: NDArray[np.float64] = ends[:, None] - step * np.arange(frames - 1, -1, -1)
    return due
