"""Videos of episodes: the camera's view and both fingers, side by side."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from tactileforge.plugins import new_part
from tactileforge_policies.rollouts.episode import Episode

#: VP9 in MP4: OpenCV's wheels write it, and browsers play it. The wheels cannot write H.264.
_FOURCC = "vp09"
#: Height of a video, pixels, even; that of the camera. An episode takes half a second to encode.
_HEIGHT = 96


def episode_frames(episode: Episode) -> list[NDArray[np.uint8]]:
    """Frames of a video, uint8 (96, W, 3): the camera, then each finger."""
    return [
        np.concatenate([_scaled(observation[name]) for name in ("image", *episode.fingers)], axis=1)
        for observation in episode.observations
    ]


def _scaled(picture: NDArray[np.uint8]) -> NDArray[np.uint8]:
    height, width = picture.shape[:2]
    size = (2 * round(width * _HEIGHT / height / 2), _HEIGHT)
    way = cv2.INTER_AREA if height > _HEIGHT else cv2.INTER_CUBIC
    return np.asarray(cv2.resize(picture, size, interpolation=way), np.uint8)


def write_video(path: Path, frames: Sequence[NDArray[np.uint8]], rate: float) -> bool:
    """Writes an MP4 for browsers; returns False if the installed OpenCV has no VP9.

    Args:
        path: Path of the video; it is written completely or not at all.
        frames: Frames, uint8 (H, W, 3), RGB, all of the same even size.
        rate: Frames per second.
    """
    height, width = frames[0].shape[:2]
    code = cv2.VideoWriter.fourcc(*_FOURCC)
    with new_part(path, path.suffix) as part:
        writer: Any = cv2.VideoWriter(str(part), cv2.CAP_FFMPEG, code, rate, (width, height))
        try:
            if not writer.isOpened():
                return False
            for frame in frames:
                writer.write(cv2.cvtColor(frame, cv2.COLOR_RGB2BGR))
        finally:
            writer.release()
        part.replace(path)
        return True
