"""Actions from forces: segments of smooth change, named by its direction.

After AnyTouch 2, appendix "Force Data". Rotations are not among them: torque is not known. The
paper gives no numbers; the thresholds below are ours.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tactileforge.contracts import ACTIONS

#: Half the window of the fit of a rate of change, s.
_HALF_WINDOW = 0.15
#: Smallest normal force of a contact, as a share of the largest.
_CONTACT = 0.05
#: Smallest rate of change of an action, as a share of the largest force, 1/s.
_RATE = 0.15
#: The same, as a multiple of the rate from noise alone (its standard error).
_NOISE = 4.0
#: Smallest share of the rate along one axis (a cosine), for a clear direction.
CLEAR = 0.8
#: Shortest segment, s.
_SHORTEST = 0.15

#: Action of a rising and of a falling force, by axis.
_NAMES = (("slide_right", "slide_left"), ("slide_down", "slide_up"), ("press", "leave"))
_LABELS = np.array([[ACTIONS.index(name) for name in pair] for pair in _NAMES])


def label_actions(times: NDArray[np.float64], force: NDArray[np.floating]) -> NDArray[np.int64]:
    """Label each frame by the change of the forces around it.

    A rate of change is fitted to 0.3 s of each component. A frame is labelled if there is contact
    (5 % of the largest normal force), if the rate is clear (15 % of the largest force in a second,
    and four times its standard error) and if it lies on one axis (within 37 degrees). Rising normal
    force is ``press``, falling one ``leave``; changing shear is a slide in the direction of the
    change. Segments shorter than 0.15 s are dropped.

    Args:
        times: float64 (T,), seconds, strictly increasing.
        force: float (T, 3), newton, axes as in `tactileforge.contracts`; NaN where unknown.

    Returns:
        int64 (T,), index into `contracts.ACTIONS`; -1 without contact, clear action or force.

    Example:
        >>> times = np.arange(60) / 30
        >>> force = np.zeros((60, 3))
        >>> force[:, 2] = np.clip(times, 0, 1) * 5
        >>> ACTIONS[label_actions(times, force)[15]]
        'press'
    """
    actions = np.full(len(times), -1, np.int64)
    known = np.isfinite(force).all(axis=1)
    if not known.any():
        return actions
    largest = float(np.linalg.norm(force[known], axis=1).max())
    contact = _CONTACT * float(force[known, 2].max())
    for rows in _runs(known):
        if len(rows) > 2 and largest > 0:
            actions[rows] = _label(times[rows], force[rows].astype(np.float64), largest, contact)
    for rows in _runs(actions):
        if times[rows[-1]] - times[rows[0]] < _SHORTEST:
            actions[rows] = -1
    return actions


def _label(
    times: NDArray[np.float64], force: NDArray[np.float64], largest: float, contact: float
) -> NDArray[np.int64]:
    level, rate, error = _fit(times, force)
    speed = np.linalg.norm(rate, axis=1)
    axis = np.abs(rate).argmax(axis=1)  # the action is named by the fastest component
    along = np.take_along_axis(rate, axis[:, None], axis=1)[:, 0]
    noise = np.take_along_axis(error, axis[:, None], axis=1)[:, 0]
    clear = (np.abs(along) > np.maximum(_RATE * largest, _NOISE * noise)) & (
        np.abs(along) >= CLEAR * speed
    )
    touching = level[:, 2] > max(contact, 0.0)
    return np.where(clear & touching, _LABELS[axis, (along < 0).astype(int)], -1)


def _fit(
    times: NDArray[np.float64], force: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Fit a line around each frame: level, slope and its standard error, (T, 3) each."""
    first = np.searchsorted(times, times - _HALF_WINDOW - 1e-9)
    last = np.searchsorted(times, times + _HALF_WINDOW + 1e-9)
    # at least three frames: at a low rate, the window may hold fewer
    row = np.arange(len(times))
    first = np.clip(np.minimum(first, row - 1), 0, len(times) - 3)
    last = np.clip(np.maximum(last, row + 2), 3, len(times))

    def window(values: NDArray[np.float64]) -> NDArray[np.float64]:
        # by cumulative sums: each window costs the same, however many frames it holds
        total = np.concatenate([np.zeros((1, *values.shape[1:])), np.cumsum(values, axis=0)])
        out: NDArray[np.float64] = total[last] - total[first]
        return out

    clock = times[:, None] - times[0]  # sums of squares lose digits where times are large
    count = (last - first)[:, None].astype(np.float64)
    mean_time, mean = window(clock) / count, window(force) / count
    spread = window(clock**2) - count * mean_time**2
    slope = (window(clock * force) - count * mean_time * mean) / spread
    level = mean + slope * (clock - mean_time)
    # second differences see the noise, not the motion: their variance is 1 + 4 + 1 times that of
    # the noise, and 0.6745 is the median of |x| of a standard normal
    bends = np.abs(np.diff(force, n=2, axis=0))
    sigma = np.median(bends, axis=0) / (0.6745 * np.sqrt(6.0))
    return level, slope, sigma / np.sqrt(spread)


def _runs(values: NDArray[np.bool_] | NDArray[np.int64]) -> list[NDArray[np.int64]]:
    """Rows of each stretch of one value, labelled or true."""
    stretches = np.split(np.arange(len(values)), np.flatnonzero(np.diff(values)) + 1)
    unset = False if values.dtype == bool else -1
    return [rows for rows in stretches if len(rows) and values[rows[0]] != unset]
