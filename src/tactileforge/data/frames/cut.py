"""Cuts clips by time: one rule for training, videos, calibration and live sensors."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from tactileforge.data.labels.align import nearest

#: Longest spacing, over the one that is asked for, that passes without a warning: a camera whose
#: rate is no multiple of it is off by a third at most.
_STRETCH = 4 / 3


def frame_period(times: NDArray[np.float64]) -> float:
    """Seconds between frames: the median, which a lost or a late frame does not change.

    Of an even number the lower one: half way between two rates lies none.

    Args:
        times: float64 (n,), at least two.
    """
    return float(np.quantile(np.diff(times), 0.5, method="lower"))


def clip_step(period: float, spacing: float) -> float:
    """Seconds between the frames of a clip: whole periods, as near to the spacing as that goes.

    Example:
        >>> clip_step(0.03, 0.0667)
        0.06
    """
    return max(1, round(spacing / period)) * period


def is_slow(period: float, spacing: float, frames: int) -> bool:
    """Whether frames come too seldom for clips of a spacing.

    Args:
        period: Seconds between the frames that come.
        spacing: Seconds between the frames of a clip.
        frames: Of a clip.

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
    """Rows of the clips that end with some frames, int64 (N, T), oldest first.

    By time, also where the rate varies: of each frame the one that is nearest. Before the first
    frame and in a gap a frame is held.

    Args:
        times: float64 (n,), seconds, increasing.
        ends: The last row of each clip.
        frames: Of a clip, T.
        spacing: Seconds between them.
        period: Seconds between the frames of the camera; None takes the median of ``times``.

    Example:
        >>> held_clips(np.arange(8) / 30, [1, 7], 4, 1 / 15).tolist()
        [[0, 0, 0, 1], [1, 3, 5, 7]]
    """
    last = np.asarray(ends, np.int64)
    if frames == 1 or len(times) == 1:
        return np.repeat(last[:, None], frames, axis=1)
    period = frame_period(times) if period is None else period
    wanted = _wanted(times[last], frames, clip_step(period, spacing))
    return nearest(times, wanted.ravel()).reshape(wanted.shape)


def whole_clips(
    times: NDArray[np.float64], rows: NDArray[np.int64], spacing: float, period: float | None = None
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Checks that clips reach as far back as they should, and have no gap; bool (N,) both.

    A frame that was lost is replaced by its neighbour; a longer gap is one.

    Args:
        times: See `held_clips`.
        rows: Of `held_clips`, int64 (N, T).
        spacing: See `held_clips`.
        period: See `held_clips`.
    """
    frames = rows.shape[1]
    if frames == 1:
        return np.ones(len(rows), np.bool_), np.ones(len(rows), np.bool_)
    if len(times) == 1:
        return np.zeros(len(rows), np.bool_), np.ones(len(rows), np.bool_)
    period = frame_period(times) if period is None else period
    step = clip_step(period, spacing)
    wanted = _wanted(times[rows[:, -1]], frames, step)
    away = np.abs(times[rows] - wanted.clip(min=times[0]))
    return wanted[:, 0] >= times[0] - period / 2, away.max(axis=1) <= 1.01 * step


def clip_rows(
    times: NDArray[np.float64], frames: int, spacing: float, period: float | None = None
) -> list[int] | None:
    """Rows of the clip that ends with the last frame.

    Args:
        times: See `held_clips`.
        frames: See `held_clips`.
        spacing: See `held_clips`.
        period: See `held_clips`.

    Returns:
        Rows, oldest first; None where the frames do not reach back far enough, or have a gap.

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


def _wanted(ends: NDArray[np.float64], frames: int, step: float) -> NDArray[np.float64]:
    """Times of the frames of clips that end at some times, (N, T)."""
    wanted: NDArray[np.float64] = ends[:, None] - step * np.arange(frames - 1, -1, -1)
    return wanted
