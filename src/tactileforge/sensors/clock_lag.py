"""Detection of late or early times of frames, and of slow or fast clocks."""

from __future__ import annotations

import numpy as np

#: Window for the smallest lag, s: frames wait for a busy machine, but not all of them.
_WINDOW = 0.5
#: Largest number of windows; beyond it, two become one.
_MOST = 240
#: Smallest number of windows for a statement.
_LEAST = 5
#: Smallest lag and smallest lead to report, s.
_LATE, _EARLY = 1.0, 0.1
#: Smallest growth of the lag to report, seconds a second and s, and the share of its variance on a
#: line. Quartz clocks are off by a ten-thousandth at most: 2 % is a wrong rate.
_DRIFT, _GROWTH, _LINE = 0.02, 0.2, 0.95


class ClockLag:
    """Monitor of the delay between the time of a frame and its arrival.

    Example:
        >>> lag = ClockLag()
        >>> sum(lag.add(0.8 * number / 30, number / 30) for number in range(300))
        20
        >>> lag.trouble()
        "its clock is 20 % slow: seconds of its times are not those of this machine's"
    """

    def __init__(self) -> None:
        self._window = _WINDOW
        self._ends: list[float] = []
        self._least: list[float] = []
        self._end = -np.inf

    def add(self, taken: float, now: float) -> bool:
        """Add a frame.

        Args:
            taken: Time of the frame, monotonic seconds.
            now: Time of its arrival, on the same clock.

        Returns:
            Whether a window has begun with it, so that `trouble` may tell something new.
        """
        if now >= self._end:
            if len(self._ends) == _MOST:
                # twice as wide windows: the whole recording is looked at in bounded memory
                self._ends = self._ends[::2]
                pairs = zip(self._least[::2], self._least[1::2], strict=True)
                self._least = [min(pair) for pair in pairs]
                self._window *= 2
            self._end = now + self._window
            self._ends.append(now)
            self._least.append(now - taken)
            return True
        self._least[-1] = min(self._least[-1], now - taken)
        return False

    def trouble(self) -> str:
        """Problem of the times so far, in words; "" for none."""
        if len(self._ends) < _LEAST:
            return ""
        # without the last window, which is not over
        ends, least = np.array(self._ends[:-1]), np.array(self._least[:-1])
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
    """Growth of a linear lag, seconds a second; 0 for none."""
    spread = times - times.mean()
    slope = float(spread @ lags / (spread @ spread))
    line = slope * spread
    rest = lags - lags.mean() - line
    if abs(slope) < _DRIFT or abs(slope) * times[-1] < _GROWTH:
        return 0.0
    return slope if line @ line > _LINE * (line @ line + rest @ rest) else 0.0
