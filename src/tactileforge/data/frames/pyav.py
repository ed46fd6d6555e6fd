"""Videos read by PyAV, for codecs unknown to OpenCV such as AV1."""

from __future__ import annotations

from collections.abc import Iterator
from importlib.util import find_spec
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactileforge.data.frames.video_index import VideoIndex
from tactileforge.errors import ConfigError

#: Codecs opened but not decoded by builds of OpenCV: the FFmpeg in the wheels of opencv-python has
#: only a hardware decoder for AV1.
CODECS = frozenset({"av01"})


def is_missing() -> bool:
    """Whether PyAV is not installed."""
    return find_spec("av") is None


def missing_error(path: str, codec: str) -> ConfigError:
    """Error for a video of a codec of PyAV without PyAV."""
    return ConfigError(
        f"{path}: its codec is {codec}, which this OpenCV does not decode: "
        "pip install 'tactileforge[av]' brings PyAV, which does"
    )


class PyAvCursor:
    """A video open in PyAV with its current frame number.

    Args:
        path: Path of the file.
        index: Index of the video.

    Raises:
        DataError: The first frame cannot be decoded.
        ConfigError: PyAV is not installed.
    """

    def __init__(self, path: str, index: VideoIndex) -> None:
        if is_missing():
            raise missing_error(path, index.codec)
        self.path, self.index = path, index
        self._rewind()
        self.seekable = len(index.keys) > 0

    def _rewind(self) -> None:
        import av

        try:
            # a title that is not UTF-8 must not cost the frames
            self._container: Any = av.open(self.path, metadata_errors="replace")
            self._stream: Any = self._container.streams.video[0]
            # one thread, as in `open_video`
            self._stream.codec_context.thread_count = 1
            self._frames: Iterator[Any] = self._container.decode(self._stream)
            self._frame = next(self._frames)
        except (av.FFmpegError, OSError, UnicodeError, IndexError, StopIteration) as error:
            raise self.index.damaged(self.path, 0) from error
        self.at, self._start = 0, self._seconds()

    def _seconds(self) -> float:
        """Time of the current frame in the file."""
        return float((self._frame.pts or 0) * self._stream.time_base)

    def frame(self, number: int) -> NDArray[np.uint8]:
        """Decode a frame: uint8 (H, W, 3), BGR.

        Raises:
            DataError: The frame cannot be decoded.
        """
        import av

        behind = number < self.at
        skips = self.seekable and self.index.skips(self.at, number)
        try:
            if (behind or skips) and not self._seek(number):
                self._rewind()
            while self.at < number:
                self._frame = next(self._frames)
                self.at += 1
            frame = np.asarray(self._frame.to_ndarray(format="bgr24"), np.uint8)
        except (av.FFmpegError, StopIteration) as error:
            raise self.index.damaged(self.path, number) from error
        if frame.shape[:2] != self.index.shape:
            raise self.index.damaged(self.path, number)
        return frame

    def _seek(self, number: int) -> bool:
        """Seek to the frame or before it; false if the result cannot be verified."""
        if not self.seekable:
            return False
        seconds = self._start + float(self.index.times[number])
        place = round(seconds / self._stream.time_base)
        self._container.seek(place, stream=self._stream)
        self._frames = self._container.decode(self._stream)
        self._frame = next(self._frames)
        # times of PyAV and of OpenCV may begin differently: both are taken from the first frame
        landed = self.index.number(self._seconds() - self._start + self.index.start)
        if landed is None or landed > number:
            return False
        self.at = landed
        return True
