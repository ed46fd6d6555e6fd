"""Temporal alignment: nearest frames of two clocks, and the lag of images behind forces."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tactileforge.errors import DataError

#: Smallest number of frames shared by both signals at a lag: fewer correlate by chance.
_LEAST_SHARED = 8
#: Smallest gap in time, as a multiple of the usual step: one lost frame makes a step of 2, and is
#: none. No clip is cut across a gap, and nothing is interpolated.
LARGEST_GAP = 2.5
#: Largest difference of the correlations of two shifts that fit alike.
_ALIKE = 0.03
#: Smallest spread of a moving signal, as a share of its size; below it is rounding.
_STILL = 1e-6
#: Rounding of times that are written to the millisecond, s.
_ROUNDING = 0.0005


@dataclass(frozen=True)
class Lag:
    """Lag of images behind forces, with its confidence.

    Attributes:
        seconds: Lag, s, positive for late images; NaN for signals without motion.
        correlation: Correlation of the signals at that lag, -1 to 1; NaN without motion.
        prominence: Smallest drop of the correlation on both sides of that lag within the search.
            Near 0, other lags explain the signals as well (a ramp, or a peak at the end).
        unshifted: Correlation of the two signals without a shift.
    """

    seconds: float
    correlation: float
    prominence: float
    unshifted: float


@dataclass(frozen=True)
class Meeting:
    """Meeting of two clocks, by contacts seen by both.

    Attributes:
        seconds: Seconds to add to the times of forces; NaN for signals without motion.
        correlation: Correlation of force and images there, -1 to 1; NaN without motion.
        prominence: Smallest fall of the correlation on both sides, see `Lag`.
        other: Seconds of another shift that fits about as well, as of equal presses; NaN for none.
    """

    seconds: float = np.nan
    correlation: float = np.nan
    prominence: float = np.nan
    other: float = np.nan


def nearest(times: ArrayLike, at: ArrayLike) -> NDArray[np.int64]:
    """Indices of the nearest times; of two equally near, the earlier one.

    Args:
        times: Times to choose from, (n,), seconds, ascending; at least one.
        at: Times to find, (m,), seconds.

    Returns:
        int64 (m,), indices into ``times``.

    Raises:
        DataError: There is no time to choose from.

    Example:
        >>> nearest([0.0, 0.1, 0.2], [0.04, 0.05, 0.06, 9.0]).tolist()
        [0, 0, 1, 2]
    """
    known, sought = np.asarray(times, np.float64), np.asarray(at, np.float64)
    if not len(known):
        raise DataError("no frames to pair with: their times are empty")
    after = np.searchsorted(known, sought).clip(max=len(known) - 1)
    before = np.maximum(after - 1, 0)
    earlier = sought - known[before] <= known[after] - sought
    return np.where(earlier, before, after).astype(np.int64)


def estimate_lag(
    times: NDArray[np.float64],
    force: NDArray[np.floating],
    change: NDArray[np.floating],
    reach: float = 0.5,
) -> Lag:
    """Estimate the lag of images behind forces, s, by cross-correlation.

    The size of the normal force, the cause of the imprint, is correlated with the difference of the
    image from the background, at every shift of whole frames within ``reach``. A parabola through
    the best three shifts gives the fraction of a frame. (Measured on two recordings of known lag:
    shear added to the normal force, or rates of change, are off by 20 ms to 100 ms.) Of a recording
    with gaps in time, the longest stretch without one is used.

    Args:
        times: float64 (T,), seconds, ascending; the rate may vary.
        force: float (T, 3), N, the third is normal; a row of NaN is a frame without a label.
        change: float (T,), mean absolute difference of each frame from the background.
        reach: Largest lag to try, s, either way.

    Returns:
        The lag; all NaN for constant forces or images, too few labels, or times that do not
        increase.

    Raises:
        DataError: The arrays differ in length.

    Example:
        >>> times = np.arange(90) / 30
        >>> press = np.exp(-((times - 1.0) ** 2) / 0.02)
        >>> late = np.exp(-((times - 1.1) ** 2) / 0.02)
        >>> force = np.stack([0 * press, 0 * press, press], 1)
        >>> round(estimate_lag(times, force, late).seconds, 2)
        0.1
    """
    if not len(times) == len(force) == len(change):
        raise DataError(
            f"{len(times)} times, {len(force)} forces and {len(change)} frames: give one per frame"
        )
    steps = np.diff(times)
    if len(times) < _LEAST_SHARED or not (steps > 0).all():
        return _NO_LAG
    period = float(np.median(steps))
    # correlation needs one clock: a gap would be bridged by values that were never measured
    stretches = np.split(np.arange(len(times)), np.flatnonzero(steps > LARGEST_GAP * period) + 1)
    longest = max(stretches, key=len)
    times, force, change = times[longest], force[longest], change[longest]
    clock = np.arange(times[0], times[-1] + period / 2, period)
    pressed = _interpolate(clock, times, np.abs(force[:, 2]))
    seen = _interpolate(clock, times, np.asarray(change, np.float64))
    most = min(round(reach / period), len(clock) - _LEAST_SHARED)
    shifts = np.arange(-most, most + 1)
    correlations = np.array([_correlation(pressed, seen, shift) for shift in shifts.tolist()])
    if not np.isfinite(correlations).any():
        return _NO_LAG
    best = int(np.nanargmax(correlations))
    # a ramp correlates at every shift: only a peak with lower values on both sides tells a lag
    sides = correlations[: best + 1], correlations[best:]
    fall = correlations[best] - max(float(np.nanmin(side)) for side in sides)
    seconds = (shifts[best] + _vertex(correlations, best)) * period
    return Lag(float(seconds), float(correlations[best]), float(fall), float(correlations[most]))


def meeting(
    rows: NDArray[np.float64],
    size: NDArray[np.floating],
    times: NDArray[np.float64],
    change: NDArray[np.floating],
) -> Meeting:
    """Find the shift between the clocks of forces and images, by contacts seen by both.

    Every shift is tried at which the two share at least half of the shorter one; of shifts that fit
    about alike, the one nearest to a common start is taken.

    Args:
        rows: float64 (n,), times of forces, s, ascending.
        size: float (n,), size of the force, N.
        times: float64 (T,), times of frames, s, ascending.
        change: float (T,), difference of each frame from the background.

    Example:
        >>> rows, times = np.arange(0, 4, 0.01), np.arange(0, 3, 0.04)
        >>> press = np.exp(-((rows - 2.0) ** 2) / 0.05)
        >>> seen = np.exp(-((times - 1.5) ** 2) / 0.05)
        >>> round(meeting(rows, press, times, seen).seconds, 2)
        -0.5
    """
    if min(len(rows), len(times)) < _LEAST_SHARED:
        return Meeting()
    period = float(np.median(np.diff(times)))
    signals = [
        _interpolate(np.arange(clock[0], clock[-1] + period / 2, period), clock, values)
        for clock, values in ((rows, size), (times, change))
    ]
    shared = max(_LEAST_SHARED, min(map(len, signals)) // 2)
    shifts = np.arange(shared - len(signals[0]), len(signals[1]) - shared + 1)
    # on one axis, NaN where one has nothing: `_correlation` leaves these out
    most = max(map(len, signals))
    pressed, seen = (np.pad(x, (0, most - len(x)), constant_values=np.nan) for x in signals)
    fits = np.array([_correlation(pressed, seen, shift, shared) for shift in shifts.tolist()])
    if not np.isfinite(fits).any():
        return Meeting()
    fits = np.where(np.isfinite(fits), fits, -1.0)
    inner = np.pad(fits, 1, constant_values=-1.0)
    peaks = np.flatnonzero((fits >= inner[:-2]) & (fits >= inner[2:]))
    alike = peaks[fits[peaks] >= fits.max() - _ALIKE]
    alike = alike[np.argsort(np.abs(shifts[alike]), kind="stable")]
    offsets = [
        float((shifts[peak] + _vertex(fits, peak)) * period + times[0] - rows[0])
        for peak in alike.tolist()
    ]
    best = int(alike[0])
    fall = fits[best] - max(float(side.min()) for side in (fits[: best + 1], fits[best:]))
    far = [one for one in offsets[1:] if abs(one - offsets[0]) > LARGEST_GAP * period]
    return Meeting(offsets[0], float(fits[best]), float(fall), far[0] if far else np.nan)


_NO_LAG = Lag(np.nan, np.nan, np.nan, np.nan)


def resample(
    clock: NDArray[np.float64], times: NDArray[np.float64], values: NDArray[np.floating]
) -> NDArray[np.float64]:
    """Interpolate values linearly at other times.

    Args:
        clock: New times, float64 (m,), seconds.
        times: Measured times, float64 (n,), seconds, ascending.
        values: Measured values, float (n, C).

    Returns:
        float64 (m, C); NaN before the first time, after the last, in gaps and beside a NaN. Half a
        millisecond beyond an end is rounding, of times that were written to the millisecond.

    Example:
        >>> force = np.array([[0.0], [1.0]])
        >>> resample(np.array([0.05, 0.3]), np.array([0.0, 0.1]), force).tolist()
        [[0.5], [nan]]
    """
    out = np.stack([_interpolate(clock, times, column) for column in values.T], axis=1)
    steps = np.diff(times)
    after = np.searchsorted(times, clock).clip(1, max(1, len(times) - 1))
    outside = (clock < times[0] - _ROUNDING) | (clock > times[-1] + _ROUNDING)
    if len(steps):
        # a time of the clock that was measured keeps its value, also at the edge of a gap
        outside |= (steps[after - 1] > LARGEST_GAP * np.median(steps)) & ~np.isin(clock, times)
    out[outside] = np.nan
    return out


def _interpolate(
    clock: NDArray[np.float64], times: NDArray[np.float64], values: NDArray[np.floating]
) -> NDArray[np.float64]:
    """Interpolate values at the ticks of a clock; NaN beside a NaN."""
    known = np.isfinite(values)
    out = np.interp(clock, times, np.where(known, values, 0.0))
    # the mask is interpolated like the values: below 1, a neighbour was unknown
    out[np.interp(clock, times, known.astype(float)) < 1 - 1e-9] = np.nan
    return out


def _correlation(
    pressed: NDArray[np.float64],
    seen: NDArray[np.float64],
    shift: int,
    least: int = _LEAST_SHARED,
) -> float:
    """Correlation of force and images ``shift`` ticks later; NaN if either is constant."""
    count = len(pressed) - abs(shift)
    a = pressed[max(0, -shift) :][:count]
    b = seen[max(0, shift) :][:count]
    both = np.isfinite(a) & np.isfinite(b)
    if both.sum() < least:
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
    # a peak bends down; NaN at a neighbour makes the comparison false
    bend = left - 2 * middle + right
    return float(0.5 * (left - right) / bend) if bend < 0 else 0.0
