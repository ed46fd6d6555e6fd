"""Temporal alignment: nearest frames of two clocks, and the lag of images behind forces."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tactileforge.errors import DataError

#: Frames that both signals must share at a lag for their correlation there to count.
_LEAST_SHARED = 8
#: Step in time, as a multiple of the usual one, that is a gap.
_GAP = 2.5
#: A signal whose spread is below this share of its size does not move (rounding, not touch).
_STILL = 1e-6


@dataclass(frozen=True)
class Lag:
    """Lag of images behind forces, with its confidence.

    Attributes:
        seconds: Positive where images are late; NaN where nothing moves.
        correlation: Of the two signals at that lag, -1 to 1; NaN where nothing moves.
        prominence: How far the correlation falls on both sides of that lag within the search. Near
            0 other lags explain the signals as well (a ramp, or a peak at the end of the search).
        unshifted: Correlation of the two signals as they are, without a lag.
    """

    seconds: float
    correlation: float
    prominence: float
    unshifted: float


def nearest(times: ArrayLike, at: ArrayLike) -> NDArray[np.int64]:
    """Index of the nearest of ``times`` for each time in ``at``; the earlier of two equally near.

    Args:
        times: (n,), seconds, ascending; at least one.
        at: (m,), seconds.

    Returns:
        int64 (m,), indices into ``times``.

    Raises:
        DataError: There is no time to choose from.

    Example:
        >>> nearest([0.0, 0.1, 0.2], [0.04, 0.05, 0.06, 9.0]).tolist()
        [0, 0, 1, 2]
    """
    known, wanted = np.asarray(times, np.float64), np.asarray(at, np.float64)
    if not len(known):
        raise DataError("no frames to pair with: their times are empty")
    after = np.searchsorted(known, wanted).clip(max=len(known) - 1)
    before = np.maximum(after - 1, 0)
    earlier = wanted - known[before] <= known[after] - wanted
    return np.where(earlier, before, after).astype(np.int64)


def estimate_lag(
    times: NDArray[np.float64],
    force: NDArray[np.floating],
    change: NDArray[np.floating],
    reach: float = 0.5,
) -> Lag:
    """Estimates the lag of images behind forces, s, by cross-correlation.

    The size of the normal force, which makes the imprint, is correlated with how much the image
    differs from the background, at every shift of whole frames within ``reach``; a parabola through
    the best three gives the fraction of a frame. (Measured on two recordings of known lag: shear
    added to the normal force, or rates of change, are off by 20 ms to 100 ms.) Of a recording with
    gaps in time, the longest stretch without one is used.

    Args:
        times: float64 (T,), seconds, ascending; the rate may vary.
        force: float (T, 3), newton, the third is normal; a row of NaN is a frame without a label.
        change: float (T,), mean absolute difference of each frame from the background.
        reach: Largest lag that is looked for, s, either way.

    Returns:
        The lag; all NaN where force or image do not move, labels are too few, or times do not
        increase.

    Raises:
        DataError: The arrays differ in length.
    """
    if not len(times) == len(force) == len(change):
        raise DataError(
            f"{len(times)} times, {len(force)} forces and {len(change)} frames: give one a frame"
        )
    steps = np.diff(times)
    if len(times) < _LEAST_SHARED or not (steps > 0).all():
        return _NO_LAG
    period = float(np.median(steps))
    # correlation needs one clock: a gap would be bridged by values that were never measured
    stretches = np.split(np.arange(len(times)), np.flatnonzero(steps > _GAP * period) + 1)
    longest = max(stretches, key=len)
    times, force, change = times[longest], force[longest], change[longest]
    clock = np.arange(times[0], times[-1] + period / 2, period)
    pressed = _resampled(clock, times, np.abs(force[:, 2]))
    seen = _resampled(clock, times, np.asarray(change, np.float64))
    most = min(round(reach / period), len(clock) - _LEAST_SHARED)
    shifts = np.arange(-most, most + 1)
    correlations = np.array([_correlation(pressed, seen, shift) for shift in shifts.tolist()])
    if not np.isfinite(correlations).any():
        return _NO_LAG
    best = int(np.nanargmax(correlations))
    # prominence: a ramp correlates at every shift, so the peak has to fall off on both sides
    sides = correlations[: best + 1], correlations[best:]
    fall = correlations[best] - max(float(np.nanmin(side)) for side in sides)
    seconds = (shifts[best] + _vertex(correlations, best)) * period
    return Lag(float(seconds), float(correlations[best]), float(fall), float(correlations[most]))


_NO_LAG = Lag(np.nan, np.nan, np.nan, np.nan)


def resampled(
    clock: NDArray[np.float64], times: NDArray[np.float64], values: NDArray[np.floating]
) -> NDArray[np.float64]:
    """Values at other times, between two measured ones in proportion.

    Args:
        clock: float64 (m,), seconds.
        times: float64 (n,), seconds, ascending.
        values: float (n, C), measured at these.

    Returns:
        float64 (m, C); NaN before the first time, after the last, in gaps and beside a NaN.

    Example:
        >>> force = np.array([[0.0], [1.0]])
        >>> resampled(np.array([0.05, 0.3]), np.array([0.0, 0.1]), force).tolist()
        [[0.5], [nan]]
    """
    out = np.stack([_resampled(clock, times, column) for column in values.T], axis=1)
    steps = np.diff(times)
    after = np.searchsorted(times, clock).clip(1, max(1, len(times) - 1))
    outside = (clock < times[0]) | (clock > times[-1])
    if len(steps):
        outside |= (steps[after - 1] > _GAP * np.median(steps)) & ~np.isin(clock, times)
    out[outside] = np.nan
    return out


def _resampled(
    clock: NDArray[np.float64], times: NDArray[np.float64], values: NDArray[np.floating]
) -> NDArray[np.float64]:
    """Interpolates values at the ticks of a clock; NaN beside a NaN."""
    known = np.isfinite(values)
    out = np.interp(clock, times, np.where(known, values, 0.0))
    out[np.interp(clock, times, known.astype(float)) < 1 - 1e-9] = np.nan
    return out


def _correlation(pressed: NDArray[np.float64], seen: NDArray[np.float64], shift: int) -> float:
    """Correlation of force and images ``shift`` ticks later; NaN where either is constant."""
    count = len(pressed) - abs(shift)
    a = pressed[max(0, -shift) :][:count]
    b = seen[max(0, shift) :][:count]
    both = np.isfinite(a) & np.isfinite(b)
    if both.sum() < _LEAST_SHARED:
        return float("nan")
    a, b = a[both], b[both]
    if a.std() <= _STILL * np.abs(a).max() or b.std() <= _STILL * np.abs(b).max():
        return float("nan")
    return float(np.corrcoef(a, b)[0, 1])


def _vertex(values: NDArray[np.float64], at: int) -> float:
    """Sub-sample offset of a peak, -0.5 to 0.5, by a parabola through its neighbours."""
    if not 0 < at < len(values) - 1:
        return 0.0
    left, middle, right = values[at - 1 : at + 2]
    bend = left - 2 * middle + right
    return float(0.5 * (left - right) / bend) if bend < 0 else 0.0
