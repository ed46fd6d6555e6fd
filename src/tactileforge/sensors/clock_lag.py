"""Notices times of frames that are late, early, or of a clock that runs slow."""

from __future__ import annotations

import numpy as np

#: Seconds over which the least lag is taken: frames wait for a busy machine, but not all of them.
_WINDOW = 0.5
#: Windows that are kept; where there are more, two become one.
_MOST = 240
#: Windows before anything is said.
_LEAST = 5
#: Lag, s, that is said; and how far a frame may lie ahead of the clock.
_LATE, _EARLY = 1.0, 0.1
#: Growth of the lag that is said, seconds a second and in all; and how near to a line it must lie.
_DRIFT, _GROWTH, _LINE = 0.02, 0.2, 0.95


class ClockLag:
    """Follows how long after its time a frame arrives.

    Example:
        >>> lag = ClockLag()
        >>> for number in range(300):
        ...     lag.add(0.8 * number / 30, number / 30)
        >>> lag.trouble()
        "its clock is 20 % slow: seconds of its times are not those of this machine's"
    """

    def __init__(self) -> None:
        self._window = _WINDOW
        self._ends: list[float] = []
        self._least: list[float] = []
        self._end = -np.inf

    def add(self, taken: float, now: float) -> None:
        """Adds a frame.

        Args:
            taken: Its time, monotonic seconds.
            now: When it arrived, on the same clock.
        """
        if now >= self._end:
            if len(self._ends) == _MOST:
                self._merge()
            self._end = now + self._window
            self._ends.append(now)
            self._least.append(now - taken)
        elif now - taken < self._least[-1]:
            self._least[-1] = now - taken

    def _merge(self) -> None:
        self._ends = self._ends[::2]
        pairs = zip(self._least[::2], self._least[1::2], strict=True)
        self._least = [min(pair) for pair in pairs]
        self._window *= 2

    def trouble(self) -> str:
        """What is wrong with the times so far; "" for nothing."""
        if len(self._ends) < _LEAST:
            return ""
        ends, least = np.array(self._ends[:-1]), np.array(self._least[:-1])  # the last goes on
        if drift := _drift(ends - ends[0], least):
            return (
                f"its clock is {abs(100 * drift):.0f} % {'slow' if drift > 0 else 'fast'}: seconds "
                "of its times are not those of this machine's"
            )
        lag = float(np.median(least))
        if lag > _LATE:
            return f"its times are {lag:.1f} s late: it is that far behind the other devices"
        return f"its times are {-lag:.1f} s ahead of the clock" if lag < -_EARLY else ""


def _drift(times: np.ndarray, lags: np.ndarray) -> float:
    """Growth of a lag that lies on a line, seconds a second; 0 for none."""
    spread = times - times.mean()
    slope = float(spread @ lags / (spread @ spread))
    line = slope * spread
    rest = lags - lags.mean() - line
    if abs(slope) < _DRIFT or abs(slope) * times[-1] < _GROWTH:
        return 0.0
    return slope if line @ line > _LINE * (line @ line + rest @ rest) else 0.0
