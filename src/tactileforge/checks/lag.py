"""Images late or early beside their forces."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from tactileforge.checks.doubts import Suspicion
from tactileforge.checks.sample import changes
from tactileforge.contracts import Recording
from tactileforge.data.labels.align import Lag, estimate_lag

#: Smallest lag to report, s and frames, and smallest certainty of its estimate. Estimates on
#: recordings without lag are off by up to 0.05 s.
LAG = 0.05
LAG_FRAMES = 1.5
LAG_CORRELATION = 0.8
LAG_PROMINENCE = 0.15
#: An imprint grows by shear too, after the force has: a lag below `LAG_LONG` seconds has to fit
#: better than none, by this much in the correlation.
LAG_GAIN, LAG_LONG = 0.1, 0.2
#: Gain that is sure by itself, and largest lag to try, s.
LAG_CERTAIN, LAG_REACH = 0.4, 1.0
#: Smallest and largest number of frames for an estimate of lag.
LAG_LEAST, LAG_MOST = 30, 1000


def check_lag(recording: Recording, lag: Lag) -> Iterator[Suspicion]:
    """Check the estimated lag of images behind forces."""
    late = abs(lag.seconds)
    step = recording.period
    is_better = lag.correlation - lag.unshifted >= LAG_GAIN or LAG_LONG <= late <= LAG_REACH / 2
    if is_sure(lag) and is_better and late > max(LAG, LAG_FRAMES * step):
        side = "after" if lag.seconds > 0 else "before"
        words = f"images come {late:.2g} s {side} forces (correlation {lag.correlation:.2g})"
        yield Suspicion("lag", late, words)


def is_sure(lag: Lag) -> bool:
    """Whether a lag is reliable: force and image change, and fit at one lag."""
    stands_out = lag.prominence >= LAG_PROMINENCE or lag.correlation - lag.unshifted >= LAG_CERTAIN
    return lag.correlation >= LAG_CORRELATION and stands_out


def lag_of(recording: Recording) -> Lag | None:
    """Estimate the lag of a recording with force, around its largest force.

    Returns:
        The lag; None without force, or with too few frames.

    Raises:
        DataError: A frame cannot be decoded.
    """
    force, count = recording.force, len(recording.frames)
    if force is None or count < LAG_LEAST or not np.isfinite(force[:, 2]).any():
        return None
    # around the largest force, as the rest of a long recording may be in the air
    middle = int(np.nanargmax(np.abs(force[:, 2])))
    start = min(max(0, middle - LAG_MOST // 2), max(0, count - LAG_MOST))
    stretch = slice(start, min(count, start + LAG_MOST))
    change = changes(recording, range(count)[stretch])
    return estimate_lag(recording.times[stretch], force[stretch], change, LAG_REACH)
