"""Videos made in tests."""

from collections.abc import Iterable
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray


def write_video(
    path: Path, frames: Iterable[NDArray[np.uint8]], fps: float = 25, codec: str = "MJPG"
) -> Path:
    """Writes frames, uint8 (H, W, 3), RGB, of one size, or none; creates the folder."""
    path.parent.mkdir(parents=True, exist_ok=True)
    frames = list(frames)
    size = frames[0].shape[1::-1] if frames else (48, 32)
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*codec), fps, size)
    assert writer.isOpened()
    for frame in frames:
        writer.write(np.ascontiguousarray(frame[..., ::-1]))
    writer.release()
    return path


def greys(count: int, step: int, size: tuple[int, int] = (32, 48)) -> list[NDArray[np.uint8]]:
    """Frames of one grey level each, ``step`` times their number, at most 255."""
    return [np.full((*size, 3), min(step * i, 255), np.uint8) for i in range(count)]
