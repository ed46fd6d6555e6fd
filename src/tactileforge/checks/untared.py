"""Forces other than 0 where nothing touches, by the pictures."""

from __future__ import annotations

from contextlib import suppress

import numpy as np

from tactileforge.checks.doubts import RANGE, Suspicion
from tactileforge.contracts import FrameSubset, Recording
from tactileforge.data.frames.small import shrink, strongest
from tactileforge.errors import ConfigError
from tactileforge.specs.published import spec

#: Smallest offset, as a share of the scale of its axis; fainter touches may not show in pictures.
_OFFSET = 0.05
#: Largest difference from the background of a picture without contact, grey levels: noise of real
#: videos reaches 1.8, and the faintest touches begin at 2.5.
NO_CONTACT = 2.0


def untared(recording: Recording) -> Suspicion | None:
    """Find a force without contact; decodes a few frames of doubtful recordings.

    Args:
        recording: The recording; needs a background to tell.

    Raises:
        DataError: A frame cannot be decoded.
    """
    force, rest = recording.force, recording.no_contact
    count = len(recording.frames)
    if force is None or rest is None or len(force) != count:
        return None
    # a median of frames from all over the recording, some of them perhaps in contact
    spread = rest.rows if isinstance(rest, FrameSubset) else ()
    if len(spread) and 2 * (max(spread) - min(spread)) >= count > 1:
        return None
    scale = np.ones(3)
    with suppress(ConfigError):  # the sensor is not installed here
        scale = np.array(spec(recording.sensor).force_scale)
    known = np.flatnonzero(np.isfinite(force).any(axis=1))
    if not len(known) or rest.shape != recording.frames.shape:
        return None
    level = np.nanmax(np.abs(force[known]) / scale, axis=1)
    if level.max() > RANGE:  # of another unit, as `force_out_of_range` says: no offset
        return None
    # the ends, where sensors usually rest, and the faintest force: the likeliest to show no contact
    rows = sorted({0, len(known) - 1, int(level.argmin())})
    if level[rows].max() <= _OFFSET:
        return None
    still = np.median([shrink(frame) for frame in rest.read(range(min(len(rest), 5)))], axis=0)
    frames = recording.frames.read([int(known[row]) for row in rows])
    change = [strongest(shrink(frame) - still.astype(np.float32)) for frame in frames]
    resting = [row for row, level_ in zip(rows, change, strict=True) if level_ < NO_CONTACT]
    if not resting or level[resting].min() <= _OFFSET:
        return None
    row = min(resting, key=lambda row: float(level[row]))
    values = ", ".join(f"{axis:.2g}" for axis in np.nan_to_num(force[known[row]]))
    return Suspicion("untared_force", float(level[row]), f"({values}) N where nothing touches")
