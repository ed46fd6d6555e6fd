"""Frames made small, and how much of them has changed."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

#: Largest difference of small pictures of one frame that was encoded again, grey levels.
SIMILAR = 3.0
#: Largest share of their pixels with a larger one: less than the smallest contact covers.
ELSEWHERE = 0.005
#: Width of small frames, pixels; averaging removes noise, so that faint contact shows.
_WIDTH = 128


def shrink(frame: NDArray[np.uint8]) -> NDArray[np.float32]:
    """Shrink a frame to a small width by averaging pixels."""
    height, width = frame.shape[:2]
    # INTER_AREA would not average an enlarged frame
    if width > _WIDTH:
        size = (_WIDTH, max(1, round(height * _WIDTH / width)))
        frame = cv2.resize(frame, size, interpolation=cv2.INTER_AREA)
    return frame.astype(np.float32)


def strongest(difference: NDArray[np.float32]) -> float:
    """Smoothed difference of the strongest 1 % of a small frame, grey levels."""
    # before the absolute value: noise of both signs cancels, a contact has one sign nearby
    smooth = cv2.GaussianBlur(difference, (0, 0), 1.0)
    return float(np.quantile(np.abs(smooth).mean(axis=-1), 0.99))
