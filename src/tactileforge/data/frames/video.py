"""Frames of a video: exact, lazy, and safe in forked and threaded workers."""

from __future__ import annotations

import os
import threading
from collections import OrderedDict
from collections.abc import Sequence
from pathlib import Path
from typing import TypeAlias

import cv2
import numpy as np
from numpy.typing import NDArray

from tactileforge.data.frames.crop import Crop, Cropped, check_range
from tactileforge.data.frames.pyav import CODECS, PyAvCursor, is_missing, missing_error, read_stream
from tactileforge.data.frames.video_index import VideoIndex, open_video, read_index
from tactileforge.errors import DataError

#: Endings that tell a video from an image where a layout may name either.
VIDEO_SUFFIXES = frozenset({".avi", ".gif", ".m4v", ".mkv", ".mov", ".mp4", ".mpg", ".ts", ".webm"})

#: Open videos of a process: each holds a decoder and its buffers.
_MAX_OPEN = 8


class VideoFrames(Cropped):
    """Frames of a video file.

    Opening walks through the packets of the file without decoding one. That gives the true number
    of frames (headers may announce more) and their times, also at a varying rate. Reading steps
    forward inside the codec, and seeks to save work. A seek counts only if the time of the frame
    reached proves its number; else the video is read from its start.

    PyAV (the extra ``av``) decodes codecs unknown to OpenCV: AV1 in most builds.

    An mp4 trimmed without coding it anew hides some frames by an edit list; they are left out. Such
    a file is decoded once when it is opened, and read without seeking.

    Args:
        path: Path of the file.
        crop: Left, top, width, height in pixels; None shows everything.
        stream: Number of the stream, where a file has several of video; PyAV reads those after the
            first, 0.

    Raises:
        DataNotFoundError: There is no such file.
        DataError: The file is not a video, is truncated, has more pixels than
            `untrusted.MAX_PIXELS` or more frames than `video_index.MAX_FRAMES`, or the crop lies
            outside its frames.
        ConfigError: OpenCV does not decode its codec, and PyAV is not installed.
    """

    def __init__(self, path: str | Path, crop: Crop | None = None, stream: int = 0) -> None:
        self.path, self.stream = str(path), stream
        self._index = read_stream(self.path, stream) if stream else read_index(self.path)
        super().__init__(self.path, self._index.shape, crop)
        if (
            not stream
            and self._index.codec in CODECS
            and is_missing()
            and not open_video(self.path).grab()
        ):
            raise missing_error(self.path, self._index.codec)

    @property
    def times(self) -> NDArray[np.float64]:
        """float64 (T,), seconds since the first frame."""
        return self._index.times

    @property
    def rate(self) -> float:
        """Frames per second, as stated by the header."""
        return self._index.rate

    def __len__(self) -> int:
        return len(self._index.times)

    def read(self, indices: Sequence[int]) -> NDArray[np.uint8]:
        """Decode frames; see `contracts.Frames.read`."""
        check_range(indices, len(self), self.path)
        out = np.empty((len(indices), *self.shape, 3), np.uint8)
        # a decoder has a position, which two threads would move under each other
        with _POOL.lock:
            cursor = _POOL.take(self.path, self._index, self.stream)
            # ascending, so that a clip is one walk forward, whatever the order of its rows
            for place in np.argsort(indices, kind="stable"):
                frame = self._show(cursor.frame(int(indices[place])))
                out[place] = cv2.cvtColor(frame, cv2.COLOR_BGR2RGB)
            _POOL.keep(cursor)
        return out


class _OpenCvCursor:
    """An open video with its current frame number."""

    def __init__(self, path: str, index: VideoIndex) -> None:
        self.path = path
        self.index = index
        self.number = 0
        self._rewind()

    def _rewind(self) -> None:
        self.capture = open_video(self.path)
        if not self.capture.grab():
            raise self.index.damaged(self.path, 0)
        self.at = 0
        self.seekable = len(self.index.keys) > 0 and self._reached() == 0

    def _reached(self) -> int | None:
        """Number of the current frame, found by its time."""
        return self.index.number(self.capture.get(cv2.CAP_PROP_POS_MSEC) / 1000)

    def frame(self, number: int) -> NDArray[np.uint8]:
        """Decode a frame: uint8 (H, W, 3), BGR."""
        behind = number < self.at
        skips = self.seekable and self.index.skips(self.at, number)
        if (behind or skips) and not self._seek(number):
            self._rewind()
        while self.at < number:
            if not self.capture.grab():
                raise self.index.damaged(self.path, number)
            self.at += 1
        good, frame = self.capture.retrieve()
        if not good:
            raise self.index.damaged(self.path, number)
        out: NDArray[np.uint8] = frame
        return out

    def _seek(self, number: int) -> bool:
        """Seek to the frame or before it; false if the result cannot be verified."""
        if not self.seekable:
            return False
        # OpenCV turns the number into a time by the rate of the header, so at a varying rate the
        # number to ask for is not that of the frame
        seconds = self.index.start + float(self.index.times[number])
        self.capture.set(cv2.CAP_PROP_POS_FRAMES, round(seconds * self.index.rate))
        if not self.capture.grab():
            return False
        landed = self._reached()
        if landed is None or landed > number:
            return False
        self.at = landed
        return True


Cursor: TypeAlias = _OpenCvCursor | PyAvCursor


def _cursor(path: str, index: VideoIndex, number: int) -> Cursor:
    """Open a video with OpenCV, or with PyAV for its codecs and for later streams."""
    if number:
        return PyAvCursor(path, index, number)
    try:
        return _OpenCvCursor(path, index)
    except DataError:
        if index.codec not in CODECS:
            raise
        return PyAvCursor(path, index)


class _Pool:
    """Pool of the videos used last in this process."""

    def __init__(self) -> None:
        self._inherited: list[object] = []
        self._clear()

    def reset(self) -> None:
        """Forget all videos: a forked process shares the file positions of its parent.

        None is closed: closing a decoder waits for its threads, and a fork has none of them.
        """
        self._inherited.append(self.cursors)
        self._clear()

    def _clear(self) -> None:
        self.lock = threading.Lock()
        self.cursors: OrderedDict[tuple[str, int, tuple[int, int]], Cursor] = OrderedDict()

    def take(self, path: str, index: VideoIndex, number: int) -> Cursor:
        """Take a cursor out of the pool: after an error, it is not used again."""
        found = self.cursors.pop((path, number, index.stamp), None)
        return found or _cursor(path, index, number)

    def keep(self, cursor: Cursor) -> None:
        """Put a cursor back; closes the least recently used one."""
        self.cursors[cursor.path, cursor.number, cursor.index.stamp] = cursor
        if len(self.cursors) > _MAX_OPEN:
            self.cursors.popitem(last=False)


_POOL = _Pool()
if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_POOL.reset)
