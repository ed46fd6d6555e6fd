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
from tactileforge.data.frames.pyav import CODECS, PyAvCursor, is_missing, missing
from tactileforge.data.frames.video_index import VideoIndex, open_video, read_index
from tactileforge.errors import DataError

VIDEO_SUFFIXES = frozenset({".avi", ".gif", ".m4v", ".mkv", ".mov", ".mp4", ".mpg", ".ts", ".webm"})

#: Videos that one process keeps open.
_MAX_OPEN = 8


class VideoFrames(Cropped):
    """Frames of a video file.

    Opening walks through the packets of the file without decoding one: that gives the true number
    of frames (headers may announce more) and their times, also where the rate varies. Reading steps
    forward inside the codec, and seeks where that saves work; a seek counts only if the time of the
    frame that it lands on proves its number, else the video is read from its start.

    PyAV decodes what OpenCV cannot (the extra ``av``): AV1 in most builds.

    An mp4 that was trimmed without coding it anew hides some frames and still counts them: reading
    the last ones is then an error.

    Args:
        path: The file.
        crop: Left, top, width, height in pixels; None shows everything.

    Raises:
        DataNotFoundError: There is no such file.
        DataError: It is no video, is truncated, has more pixels than `untrusted.MAX_PIXELS` or more
            frames than `video_index.MAX_FRAMES`, or the crop lies outside its frames.
        ConfigError: OpenCV does not decode its codec, and PyAV is not installed.
    """

    def __init__(self, path: str | Path, crop: Crop | None = None) -> None:
        self.path = str(path)
        self._index = read_index(self.path)
        super().__init__(self.path, self._index.shape, crop)
        if self._index.codec in CODECS and is_missing() and not open_video(self.path).grab():
            raise missing(self.path, self._index.codec)

    @property
    def times(self) -> NDArray[np.float64]:
        """float64 (T,), seconds since the first frame."""
        return self._index.times

    @property
    def rate(self) -> float:
        """Frames per second, as the header says."""
        return self._index.rate

    def __len__(self) -> int:
        return len(self._index.times)

    def read(self, indices: Sequence[int]) -> NDArray[np.uint8]:
        """Decodes; see `contracts.Frames.read`."""
        check_range(indices, len(self), self.path)
        out = np.empty((len(indices), *self.shape, 3), np.uint8)
        with _POOL.lock:
            cursor = _POOL.take(self.path, self._index)
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
        self._rewind()

    def _rewind(self) -> None:
        self.capture = open_video(self.path)
        if not self.capture.grab():
            raise self.index.damaged(self.path, 0)
        self.at = 0
        self.seekable = len(self.index.keys) > 0 and self._number() == 0

    def _number(self) -> int | None:
        """Number of the current frame, by its time."""
        return self.index.number(self.capture.get(cv2.CAP_PROP_POS_MSEC) / 1000)

    def frame(self, wanted: int) -> NDArray[np.uint8]:
        """Decodes a frame: uint8 (H, W, 3), BGR."""
        behind = wanted < self.at
        skips = self.seekable and self.index.skips(self.at, wanted)
        if (behind or skips) and not self._seek(wanted):
            self._rewind()
        while self.at < wanted:
            if not self.capture.grab():
                raise self.index.damaged(self.path, wanted)
            self.at += 1
        good, frame = self.capture.retrieve()
        if not good:
            raise self.index.damaged(self.path, wanted)
        out: NDArray[np.uint8] = frame
        return out

    def _seek(self, wanted: int) -> bool:
        """Seeks to the frame or before it; false where that cannot be verified."""
        if not self.seekable:
            return False
        seconds = self.index.start + float(self.index.times[wanted])
        self.capture.set(cv2.CAP_PROP_POS_FRAMES, round(seconds * self.index.rate))
        if not self.capture.grab():
            return False
        landed = self._number()
        if landed is None or landed > wanted:
            return False
        self.at = landed
        return True


Cursor: TypeAlias = _OpenCvCursor | PyAvCursor


def _cursor(path: str, index: VideoIndex) -> Cursor:
    """Opens a video with the library that decodes it."""
    try:
        return _OpenCvCursor(path, index)
    except DataError:
        if index.codec not in CODECS:
            raise
        return PyAvCursor(path, index)


class _Pool:
    """The videos used last in this process."""

    def __init__(self) -> None:
        self._inherited: list[object] = []
        self._clear()

    def reset(self) -> None:
        """Forgets everything: a forked process shares the file positions of its parent.

        Closing a decoder waits for its threads, which only the parent has: so none is closed.
        """
        self._inherited.append(self.cursors)
        self._clear()

    def _clear(self) -> None:
        self.lock = threading.Lock()
        self.cursors: OrderedDict[tuple[str, tuple[int, int]], Cursor] = OrderedDict()

    def take(self, path: str, index: VideoIndex) -> Cursor:
        """Takes a cursor out, so that one that fails is not used again."""
        return self.cursors.pop((path, index.stamp), None) or _cursor(path, index)

    def keep(self, cursor: Cursor) -> None:
        """Puts a cursor back, closing the one that has waited longest."""
        self.cursors[cursor.path, cursor.index.stamp] = cursor
        if len(self.cursors) > _MAX_OPEN:
            self.cursors.popitem(last=False)


_POOL = _Pool()
if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_POOL.reset)
