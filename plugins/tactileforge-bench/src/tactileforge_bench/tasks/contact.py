"""Estimates from the images when a grasped object is lost."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from tactileforge.contracts import Recording

#: Width and height for the comparison: a mean over areas, in which noise of pixels cancels.
_SIZE = (40, 30)
#: Grey levels that are noise, and the share of what is usual above it that is contact.
_NOISE, _SHARE = 1.0, 0.3
#: Seconds before the loss that count as losing, and between which an object is held. All contacts
#: that count last as long, so that every recording has as much of each. Both are of one video,
#: because much besides slip tells videos apart (docs/reports/gate.md).
LOSING_S, HELD_S = 0.32, (0.8, 1.6)
#: Frames at the end that have to be without contact.
_AFTER = 3
#: Frames that are decoded at once.
_CHUNK = 64


def contact_energy(recording: Recording) -> NDArray[np.float64]:
    """Mean change from the background of each frame, grey levels, (frames,).

    Args:
        recording: One with frames without contact.
    """
    rest = recording.background()
    assert rest is not None
    background = _small(rest)
    means = []
    for start in range(0, len(recording.frames), _CHUNK):
        rows = range(start, min(start + _CHUNK, len(recording.frames)))
        means += [np.abs(_small(f) - background).mean() for f in recording.frames.read(rows)]
    return np.array(means)


def last_contact(change: NDArray[np.float64]) -> tuple[int, int] | None:
    """First and last frame of the last contact.

    None where the recording ends in contact, or never has any.

    Args:
        change: Contact energy of each frame, float64; see `contact_energy`.
    """
    # a high percentile stands for the firm grasp: the maximum may be one bad frame
    bound = _NOISE + _SHARE * max(float(np.percentile(change, 80)) - _NOISE, 0.0)
    there = np.flatnonzero(change > bound)
    if not len(there) or there[-1] >= len(change) - _AFTER:
        return None
    apart = np.flatnonzero(change[: there[-1]] <= bound)
    return int(apart[-1]) + 1 if len(apart) else 0, int(there[-1])


def contact_state(
    contact: tuple[int, int] | None, frame: int, times: NDArray[np.float64]
) -> str | None:
    """Contact state: ``held``, ``losing``, or None elsewhere or if contact is unknown or too short.

    Args:
        contact: First and last frame of the contact, or None; see `last_contact`.
        frame: Frame in question.
        times: Seconds of each frame.
    """
    # rounded, as differences of times have rounding errors of their own
    if contact is None or round(times[contact[1]] - times[contact[0]], 6) < HELD_S[1]:
        return None
    # rounded, so that frames on a bound count alike in every recording
    before = round(float(times[contact[1]] - times[frame]), 6)
    if HELD_S[0] <= before <= HELD_S[1]:
        return "held"
    return "losing" if 0 <= before <= LOSING_S else None


def _small(frame: NDArray[np.uint8]) -> NDArray[np.float64]:
    small: NDArray[np.float64] = cv2.resize(frame, _SIZE, interpolation=cv2.INTER_AREA) * 1.0
    return small
