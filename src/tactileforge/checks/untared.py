"""Forces other than 0 where nothing touches, by the pictures."""

from __future__ import annotations

from contextlib import suppress

import numpy as np
from numpy.typing import NDArray

from tactileforge.checks.doubts import RANGE, Suspicion
from tactileforge.checks.sample import FrameSample
from tactileforge.contracts import FrameSubset, Recording
from tactileforge.data.frames.small import shrink, strongest
from tactileforge.errors import ConfigError
from tactileforge.specs.published import spec

#: Smallest offset, as a share of the scale of its axis; fainter touches may not show in pictures.
_OFFSET = 0.05
#: Largest difference from the background of a picture without contact, grey levels: noise of real
#: videos reaches 1.8, and the faintest touches begin at 2.5.
NO_CONTACT = 2.0
#: Frames at rest early, and late, and the largest range of a force among them over the drift.
_RESTS, _STEADY = 2, 0.7


def is_spread(recording: Recording) -> bool:
    """Whether the background is a median of frames from all over, some perhaps in contact."""
    rest, count = recording.no_contact, len(recording.frames)
    spread = rest.rows if isinstance(rest, FrameSubset) else ()
    return bool(len(spread)) and 2 * (max(spread) - min(spread)) >= count > 1


def scale_of(recording: Recording) -> NDArray[np.float64]:
    """Force scale of the sensor, (3,), N; 1 for a sensor not installed here."""
    with suppress(ConfigError):
        return np.array(spec(recording.sensor).force_scale, np.float64)
    return np.ones(3)


def drifted(recording: Recording, seen: FrameSample) -> Suspicion | None:
    """Find another force at rest late in a recording than early.

    Args:
        recording: The recording; needs a background to tell.
        seen: Some of its frames.
    """
    force, still = recording.force, seen.background
    if force is None or still is None or len(force) != len(recording.frames):
        return None
    scale = scale_of(recording)
    shares = force / scale
    if is_spread(recording) or np.nanmax(np.abs(shares), initial=0.0) > RANGE:
        return None
    at_rest = [strongest(frame - still) < NO_CONTACT for frame in seen.frames]
    rows = seen.rows[at_rest]
    rows = rows[np.isfinite(force[rows]).any(axis=1)]
    count = max(_RESTS, len(rows) // 3)
    if len(rows) < 2 * _RESTS:
        return None
    early, late = shares[rows[:count]], shares[rows[-count:]]
    drift = np.median(late, axis=0) - np.median(early, axis=0)
    # a rest is steady: a touch that begins may not show in its picture yet
    noise = np.maximum(np.ptp(early, axis=0), np.ptp(late, axis=0))
    known = np.where(noise < _STEADY * np.abs(drift), np.abs(drift), 0.0)
    axis = int(np.nan_to_num(known).argmax())
    if not known[axis] > _OFFSET:
        return None
    first, last = (float(np.median(part[:, axis]) * scale[axis]) for part in (early, late))
    words = f"{'xyz'[axis]} is {first:.2g} N at rest at first, and {last:.2g} N at rest at last"
    return Suspicion("drifting_force", float(known[axis]), words)


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
    if is_spread(recording):
        return None
    scale = scale_of(recording)
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
