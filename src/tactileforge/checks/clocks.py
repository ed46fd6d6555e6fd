"""Stamps of several clocks, against the times of recording."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike

#: Largest difference of two delays of one clock, s: messages wait a few hundredths at most.
APART = 0.05
#: Smallest number of messages to tell a delay.
_LEAST = 3


def clocks_apart(stamps: Mapping[str, tuple[ArrayLike, ArrayLike]], most: float = APART) -> str:
    """Tell stamps that come from several clocks; "" where they come from one.

    Args:
        stamps: For each topic, the stamps of its messages and the times at which these were
            recorded, (n,) each, s.
        most: Largest difference of the medians of (stamp - time of recording), s.

    Example:
        >>> import numpy as np
        >>> at = np.arange(5.0)
        >>> clocks_apart({"image": (at + 37, at), "wrench": (at, at)})[:59]
        'stamps of image are 37 s ahead of the times of recording, t'
    """
    ahead = {}
    for topic, (stamp, received) in stamps.items():
        difference = np.asarray(stamp, np.float64) - np.asarray(received, np.float64)
        difference = difference[np.isfinite(difference)]
        if len(difference) >= _LEAST:
            ahead[topic] = float(np.median(difference))
    if len(ahead) < 2:
        return ""
    first, last = max(ahead, key=lambda topic: ahead[topic]), min(ahead, key=lambda t: ahead[t])
    if ahead[first] - ahead[last] <= most:
        return ""
    return (
        f"stamps of {first} are {_ahead(ahead[first])} the times of recording, those of {last} "
        f"{_ahead(ahead[last])}: the clocks differ by {ahead[first] - ahead[last]:.3g} s"
    )


def _ahead(seconds: float) -> str:
    return f"{abs(seconds):.3g} s {'ahead of' if seconds >= 0 else 'behind'}"


def repeated_times(times: Sequence[float] | ArrayLike) -> float:
    """Share of steps that are far shorter than usual, as of frames stored twice.

    Args:
        times: Times of the frames, (n,), s.

    Example:
        >>> repeated_times([0, 0.0001, 1, 1.0001, 2, 2.0001, 3, 3.0001])
        0.5714285714285714
    """
    steps = np.diff(np.asarray(times, np.float64))
    if len(steps) < 2 * _LEAST:
        return 0.0
    # of pairs, every other step is one of the camera: the upper half tells how long these are
    usual = float(np.quantile(steps, 0.75))
    return float((steps < 0.05 * usual).mean())
