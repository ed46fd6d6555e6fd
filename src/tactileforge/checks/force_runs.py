"""Stretches of a recording with constant forces, or without any."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

#: Longest plausible run of one and the same force other than 0, s, and share of the recording:
#: strain gauges have noise.
_STUCK, _STUCK_SHARE = 1.0, 0.25
#: The same for a sensor with noise before and after: at most this share of its other samples equal
#: the one before.
_NOISY_STUCK, _NOISE = 2.0, 0.1
#: Rows from which constant forces are no coincidence.
FRAMES = 10
#: Rows at the largest force from which it is the end of a range.
FLAT = 6
#: Longest plausible time without forces before the first or after the last, s, and share of the
#: recording; and share of the rows between that have one, for forces that are not rare.
_AWAY, _AWAY_SHARE, _WHOLE = 1.0, 0.1, 0.9


def stuck(force: NDArray[np.floating], times: NDArray[np.float64]) -> str:
    """Longest time of one and the same force other than 0, in words; "" for a plausible one.

    Args:
        force: Forces, (T, 3), N.
        times: Times of the rows, (T,), s.
    """
    if len(force) != len(times) or len(force) < FRAMES:
        return ""
    same = (force[1:] == force[:-1]).all(axis=1) & (force[1:] != 0).any(axis=1)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], same, [False]]).astype(np.int8)))
    runs = edges.reshape(-1, 2)
    # a whole recording of one force is said of the set, or is a still that was filmed
    if not len(runs) or same.all():
        return ""
    lengths = times[runs[:, 1]] - times[runs[:, 0]]
    start, stop = runs[int(lengths.argmax())]
    longest = float(lengths.max())
    others = np.delete(same, slice(start, stop))
    is_noisy = len(others) >= FRAMES and others.mean() <= _NOISE
    most = max(_STUCK, _STUCK_SHARE * float(times[-1] - times[0]))
    most = min(most, _NOISY_STUCK) if is_noisy else most
    return f"{longest:.3g} s of one and the same force" if longest > most else ""


def cut_off(force: NDArray[np.floating], axis: int) -> float | None:
    """Largest force along an axis, N, if held exactly, unlike smaller ones.

    Args:
        force: Forces, (T, 3), N.
        axis: 0, 1 or 2.

    Returns:
        The force with its sign; None for one that comes and goes.
    """
    values = force[np.isfinite(force[:, axis]), axis]
    if not len(values) or not np.abs(values).any():
        return None
    top = float(values[np.abs(values).argmax()])
    same = values[1:] == values[:-1]
    at_top = values[1:] == top
    others = same[~at_top & (values[1:] != 0)]
    is_long = int((same & at_top).sum()) >= FLAT - 1
    return top if is_long and len(others) >= FRAMES and others.mean() <= _NOISE else None


def between(force: NDArray[np.floating]) -> tuple[float, str]:
    """Share of the frames from the first force to the last that have none, and in words.

    Args:
        force: Forces, (T, 3), N; NaN for a missing one.
    """
    known = np.flatnonzero(np.isfinite(force).any(axis=1))
    count = int(known[-1] - known[0]) + 1 if len(known) else 0
    if count == len(known):
        return 0.0, ""
    words = f"{len(known)} of {count} frames from the first force to the last have one"
    return 1 - len(known) / count, words


def away(force: NDArray[np.floating], times: NDArray[np.float64]) -> str:
    """Time without forces before the first or after the last, in words; "" for a short one.

    Args:
        force: Forces, (T, 3), N; NaN for a missing one.
        times: Times of the rows, (T,), s.
    """
    known = np.flatnonzero(np.isfinite(force).any(axis=1))
    if len(force) != len(times) or not len(known):
        return ""
    if len(known) < _WHOLE * max(2, known[-1] - known[0] + 1):
        return ""
    late, early = float(times[known[0]] - times[0]), float(times[-1] - times[known[-1]])
    if max(late, early) <= max(_AWAY, _AWAY_SHARE * float(times[-1] - times[0])):
        return ""
    if late >= early:
        return f"{late:.3g} s until the first force"
    return f"{early:.3g} s after the last force"
