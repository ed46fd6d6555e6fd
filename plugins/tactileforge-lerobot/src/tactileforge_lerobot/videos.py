"""Video files of a written LeRobot data set."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from tactileforge.contracts import Frames
from tactileforge.errors import DataError
from tactileforge_lerobot import folder

#: MPEG-4 part 2, in mp4: every build of OpenCV writes it, and every FFmpeg reads it.
_FOURCC, _CODEC = "mp4v", "mpeg4"
#: Frames read at once.
_PART = 32


class Videos:
    """Videos of one feature, with consecutive episodes in one file.

    Args:
        root: Folder of the data set.
        name: Name of the feature.
        size: Width and height, even.
        fps: Frames per second.
        limit: Size of a file from which a new one is begun, MB.
    """

    def __init__(
        self, root: Path, name: str, size: tuple[int, int], fps: int, limit: float
    ) -> None:
        self.root, self.name, self.size, self.fps, self.limit = root, name, size, fps, limit
        self.file = self.frames = 0
        self._open: Any = None

    @property
    def _path(self) -> Path:
        return self.root / folder.VIDEO.format(
            video_key=self.name, **folder.chunk_and_file(self.file)
        )

    def add(self, frames: Frames) -> dict[str, Any]:
        """Appends an episode, and returns its location.

        Raises:
            DataError: The installed OpenCV cannot write MPEG-4.
        """
        if self._open is not None and self._path.stat().st_size > self.limit * 1e6:
            self.close()
            self.file, self.frames = self.file + 1, 0
        if self._open is None:
            self._path.parent.mkdir(parents=True, exist_ok=True)
            code = cv2.VideoWriter.fourcc(*_FOURCC)
            self._open = cv2.VideoWriter(
                str(self._path), cv2.CAP_FFMPEG, code, float(self.fps), self.size
            )
            if not self._open.isOpened():
                raise DataError(f"{self._path}: this OpenCV cannot write MPEG-4; give images=png")
        start = self.frames
        for part in read_parts(frames):
            for frame in _pad_to_even(part):
                self._open.write(cv2.cvtColor(frame, cv2.COLOR_RGB2BGR))
        self.frames += len(frames)
        about = {**folder.chunk_and_file(self.file), "from_timestamp": start / self.fps}
        about["to_timestamp"] = self.frames / self.fps
        return {f"videos/{self.name}/{key}": value for key, value in about.items()}

    def close(self) -> None:
        """Ends the file."""
        if self._open is not None:
            self._open.release()
            self._open = None

    def info(self) -> dict[str, Any]:
        """Description of a video in LeRobot's format."""
        return {
            "video.height": self.size[1],
            "video.width": self.size[0],
            "video.codec": _CODEC,
            "video.pix_fmt": "yuv420p",
            "video.is_depth_map": False,
            "video.fps": self.fps,
            "video.channels": 3,
            "has_audio": False,
        }


def read_parts(frames: Frames) -> Iterator[NDArray[np.uint8]]:
    """Yields frames (n, H, W, 3), `_PART` at a time, as a whole episode may not fit in memory."""
    for start in range(0, len(frames), _PART):
        yield frames.read(range(start, min(start + _PART, len(frames))))


def _pad_to_even(frames: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Pads frames to even height and width, as videos need; repeats the last row or column."""
    _, height, width, _ = frames.shape
    if height % 2 == width % 2 == 0:
        return frames
    return np.pad(frames, ((0, 0), (0, height % 2), (0, width % 2), (0, 0)), mode="edge")
