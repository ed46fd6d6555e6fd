"""Forces of exactly 0 where the gel is pressed, as of a chunk that is missing."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tactileforge.checks.doubts import Suspicion
from tactileforge.checks.sample import FrameSample
from tactileforge.checks.untared import NO_CONTACT
from tactileforge.contracts import Recording
from tactileforge.data.frames.small import shrink, strongest

#: Smallest share of frames with a force of exactly 0 to look into.
_SHARE = 0.05
#: Frames of them that are decoded beside those of the sample, smallest share of all these with a
#: contact, and smallest number.
_LOOKED, _PRESSED, _LEAST = 6, 0.15, 2
#: Time after a force in which its imprint may last, by the gel's relaxation or a late camera, s.
_LASTS = 0.3
#: Smallest contact without a force, as a share of that at the largest force, and grey levels.
_LIKE, _CLEAR = 0.5, 3 * NO_CONTACT


def zero_where_pressed(recording: Recording, seen: FrameSample) -> Suspicion | None:
    """Find forces of exactly 0 in frames with an imprint like that of the largest force.

    Args:
        recording: The recording; needs forces and a background.
        seen: Some of its frames.

    Raises:
        DataError: A frame cannot be decoded.
    """
    force, still = recording.force, seen.background
    if force is None or still is None or len(force) != len(recording.frames):
        return None
    known = np.isfinite(force).any(axis=1)
    size = np.nan_to_num(np.abs(force)).max(axis=1)
    none = np.flatnonzero(known & (size == 0))
    if not size.any() or len(none) < max(2.0, _SHARE * known.sum()):
        return None
    # frames without force, from all over, and the one of the largest
    apart = none[_since(recording.times, known & (size > 0))[none] > _LASTS]
    if not len(apart):
        return None
    rows = {int(apart[i]) for i in np.linspace(0, len(apart) - 1, _LOOKED).astype(int)}
    known_rows = {int(row): place for place, row in enumerate(seen.rows) if row in apart}
    frames = recording.frames.read([*(rows - known_rows.keys()), int(size.argmax())])
    contact = [strongest(seen.frames[place] - still) for place in known_rows.values()]
    contact += [strongest(shrink(frame) - still) for frame in frames]
    least = max(_CLEAR, _LIKE * contact[-1])
    pressed = [one > least for one in contact[:-1]]
    if sum(pressed) < max(_LEAST, _PRESSED * len(pressed)) or contact[-1] < NO_CONTACT:
        return None
    share = len(none) / known.sum()
    words = f"force is zero for {100 * share:.0f} % of the frames, where the gel is pressed"
    return Suspicion("zero_force", float(share), words)


def _since(times: NDArray[np.float64], pressed: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Seconds since the last frame with a force, float64 (T,); inf before the first."""
    last = np.maximum.accumulate(np.where(pressed, times, -np.inf))
    return np.asarray(times - last, np.float64)
