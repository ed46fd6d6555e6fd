"""Proposals of contact and slip, from the change of the picture and the motion of the imprint."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from tactileforge.contracts import Recording
from tactileforge.errors import ConfigError
from tactileforge.sensors import ContactDetector, ContactOptions

#: Side of the averaged squares, pixels: averaging 64 pixels divides independent noise by 8.
_SQUARE = 8
#: Frames that are decoded at once.
_CHUNK = 64
#: Share of the squares that has to change for contact: a hundredth.
_PERCENT = 99


@dataclass(frozen=True, kw_only=True)
class SlipMotion:
    """Thresholds of a slip proposal.

    Attributes:
        speed: Speed of the imprint from which it counts as slip, shorter sides of the frame per
            second.
        window: Time over which the speed is measured, s.
        area: Largest relative change of the imprint's area within the window: an imprint that
            grows or shrinks is pressed or lifted.
    """

    speed: float = 0.15
    window: float = 0.1
    area: float = 0.2

    def __post_init__(self) -> None:
        if not (self.speed > 0 and self.window > 0 and self.area > 0):
            raise ConfigError("slip: give speed, window and area above 0")


@dataclass(frozen=True)
class Imprint:
    """Change of each frame from the background.

    Attributes:
        change: float64 (T,), grey levels; a hundredth of the squares changes by more.
        area: float64 (T,), share of the squares that changes by more than the threshold, 0 to 1.
        center: float64 (T, 2), mean place of these squares, weighted by their change, in shorter
            sides of the frame to the right and down; NaN without any.
    """

    change: NDArray[np.float64]
    area: NDArray[np.float64]
    center: NDArray[np.float64]


def imprint(recording: Recording, background: NDArray[np.uint8], threshold: float) -> Imprint:
    """Measures the imprint in every frame.

    Args:
        recording: Recording; its frames are decoded some at a time.
        background: Frame without contact, uint8 (H, W, 3).
        threshold: Change of a square that belongs to the imprint, grey levels.

    Raises:
        DataError: A frame cannot be decoded.
    """
    still = _squares(background)
    rows, columns = still.shape[:2]
    side = min(rows, columns)
    x, y = np.meshgrid((np.arange(columns) + 0.5) / side, (np.arange(rows) + 0.5) / side)
    change, area, center = [], [], []
    for start in range(0, len(recording.frames), _CHUNK):
        stop = min(start + _CHUNK, len(recording.frames))
        for frame in recording.frames.read(range(start, stop)):
            moved = np.abs(_squares(frame) - still).max(-1)
            weight = np.where(moved >= threshold, moved, 0.0)
            total = weight.sum()
            change.append(float(np.percentile(moved, _PERCENT)))
            area.append(float((weight > 0).mean()))
            place = ((weight * x).sum() / total, (weight * y).sum() / total) if total else None
            center.append(place or (np.nan, np.nan))
    return Imprint(np.array(change), np.array(area), np.array(center).reshape(-1, 2))


def propose(
    seen: Imprint, times: NDArray[np.float64], contact: ContactOptions, slip: SlipMotion
) -> NDArray[np.int8]:
    """Proposed state of each frame, int8 (T,): 0 free, 1 contact, 2 slip.

    Contact begins and ends at the thresholds of ``contact``. It is slip where the centre of the
    imprint moves by at least ``slip.speed`` over a window around the frame, all of it in contact,
    while its area changes by at most ``slip.area``.

    Args:
        seen: Imprint in every frame.
        times: float64 (T,), times of the frames, s.
        contact: Thresholds of contact.
        slip: Thresholds of slip.

    Example:
        >>> seen = Imprint(np.array([0.0, 9.0, 6.0, 4.0]), np.ones(4), np.zeros((4, 2)))
        >>> propose(seen, np.arange(4) / 30, ContactOptions(), SlipMotion()).tolist()
        [0, 1, 1, 0]
    """
    detector = ContactDetector(contact)
    touching = np.array([detector.update(change) for change in seen.change], bool)
    first = np.searchsorted(times, times - slip.window / 2 - 1e-9)
    last = np.searchsorted(times, times + slip.window / 2 + 1e-9) - 1
    # at a low rate a window may hold one frame: then its neighbours are compared
    first = np.maximum(np.minimum(first, np.arange(len(times)) - 1), 0)
    last = np.minimum(np.maximum(last, np.arange(len(times)) + 1), len(times) - 1)
    lifted = np.concatenate([[0], np.cumsum(~touching)])
    whole = lifted[last + 1] == lifted[first]
    seconds = np.maximum(times[last] - times[first], 1e-9)
    with np.errstate(invalid="ignore"):
        speed = np.linalg.norm(seen.center[last] - seen.center[first], axis=1) / seconds
        larger = np.maximum(seen.area[last], seen.area[first])
        steady = np.abs(seen.area[last] - seen.area[first]) <= slip.area * larger
        slips = whole & steady & (speed >= slip.speed)
    return np.where(touching, np.where(slips, 2, 1), 0).astype(np.int8)


def _squares(image: NDArray[np.uint8]) -> NDArray[np.float32]:
    """Mean of every square of 8 x 8 pixels, float32 (h, w, 3)."""
    height, width = image.shape[:2]
    size = (max(1, width // _SQUARE), max(1, height // _SQUARE))
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), np.float32)
