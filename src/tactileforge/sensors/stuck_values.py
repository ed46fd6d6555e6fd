"""Detection of a wrench sensor stuck at one value."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tactileforge.contracts import Frame, SensorSpec

#: Seconds of one value until it counts as stuck, for a sensor with noise so far, and for one
#: without any: a simulated one rests for seconds before it is loaded.
_AFTER, _FROM_START = 3.0, 10.0


class StuckValues:
    """Comparison of each sample of a wrench sensor with the one before.

    Strain gauges have noise: samples that are equal on six axes were not measured.

    Args:
        spec: Spec of the sensor; arrays and robots may repeat themselves at rest.

    Attributes:
        count: Number of samples after the value counted as stuck.
    """

    def __init__(self, spec: SensorSpec) -> None:
        self.count = 0
        self._is_wrench = spec.kind == "wrench"
        self._last: NDArray[np.float32] | None = None
        self._since, self._longest, self._after = 0.0, 0.0, _FROM_START

    def look(self, frame: Frame) -> None:
        """Add a sample with finite values."""
        if not self._is_wrench or frame.raw is None:
            return
        last, self._last = self._last, frame.raw
        if last is None or not np.array_equal(last, frame.raw):
            self._after = _FROM_START if last is None else _AFTER
            self._since = frame.time
        elif frame.time - self._since >= self._after:
            self.count += 1
            self._longest = max(self._longest, frame.time - self._since)

    def trouble(self) -> str:
        """Problem of the samples so far, in words; "" for none."""
        if not self.count:
            return ""
        return f"its values have not changed for {self._longest:.1f} s, not even by noise"
