"""Frames of a video: exact, lazy, and safe in forked and threaded workers."""

from __future__ import annotations

import os
import threading
from collections import OrderedDict
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from tactileforge.data.frames.crop import Crop, Cropped, check_range
from tactileforge.errors import DataError, DataNotFoundError
from tactileforge.untrusted import MAX_PIXELS

VIDEO_SUFFIXES = frozenset({".avi", ".gif", ".m4v", ".mkv", ".mov", ".mp4", ".mpg", ".ts", ".webm"})

# FFmpeg reads this once, when the process first opens a video. Its messages name no file.
os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")

#: Containers whose header counts frames; others estimate the count from a duration.
_COUNTED = frozenset({".avi", ".m4v", ".mov", ".mp4"})
#: Share of the announced frames that may be missing before a file counts as truncated.
_MISSING = 0.05
#: Videos that one process keeps open.
_MAX_OPEN = 8
#: OpenCV looks for a key frame at least this many frames before the one it seeks.
_SEEK_MARGIN = 16
#: Frames of a video: 38 hours at 30 a second.
MAX_FRAMES = 1 << 22

_HINT = "download it again, or convert it: ffmpeg -i IN -c:v libx264 OUT.mp4"


class VideoFrames(Cropped):
    """Frames of a video file.

    Opening walks through the packets of the file without decoding one: that gives the true number
    of frames (headers may announce more) and their times, also where the rate varies. Reading steps
    forward inside the codec, and seeks where that saves work; a seek counts only if the time of the
    frame that it lands on proves its number, else the video is read from its start.

    An mp4 that was trimmed without coding it anew hides some frames and still counts them: reading
    the last ones is then an error.

    Args:
        path: The file.
        crop: Left, top, width, height in pixels; None shows everything.

    Raises:
        DataNotFoundError: There is no such file.
        DataError: It is no video, is truncated, has more pixels than `untrusted.MAX_PIXELS` or more
            frames than `MAX_FRAMES`, or the crop lies outside its frames.
    """

    def __init__(self, path: str | Path, crop: Crop | None = None) -> None:
        self.path = str(path)
        self._index = _index(self.path)
        super().__init__(self.path, self._index.shape, crop)

    @property
    def times(self) -> NDArray[np.float64]:
        """float64 (T,), seconds since the first frame."""
        return self._index.times

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


@dataclass(frozen=True)
class _Index:
    """Facts of a video, read from its packets.

    Attributes:
        shape: Height and width.
        rate: Frames per second, by which OpenCV turns frame numbers into times.
        start: Time of the first frame in the file, s.
        times: float64 (T,), seconds since then.
        keys: Frame numbers of the key frames; none where seeking is not possible.
        stamp: Size and time of change of the file.
    """

    shape: tuple[int, int]
    rate: float
    start: float
    times: NDArray[np.float64]
    keys: NDArray[np.int64]
    stamp: tuple[int, int]

    def skips(self, at: int, wanted: int) -> bool:
        """Whether a key frame lies between the two, so that a seek saves decoding."""
        before = int(np.searchsorted(self.keys, wanted - _SEEK_MARGIN, side="right")) - 1
        return before >= 0 and int(self.keys[before]) > at + 1

    def number(self, seconds: float) -> int | None:
        """Number of the frame with this time in the file; None where there is none."""
        seconds -= self.start
        i = int(np.searchsorted(self.times, seconds - 5e-4))
        is_there = i < len(self.times) and abs(float(self.times[i]) - seconds) < 5e-4
        return i if is_there else None


class _Cursor:
    """An open video with its current frame number."""

    def __init__(self, path: str, index: _Index) -> None:
        self.path = path
        self.index = index
        self._rewind()

    def _rewind(self) -> None:
        self.capture = _open(self.path)
        if not self.capture.grab():
            raise self._damaged(0)
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
                raise self._damaged(wanted)
            self.at += 1
        good, frame = self.capture.retrieve()
        if not good:
            raise self._damaged(wanted)
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

    def _damaged(self, wanted: int) -> DataError:
        count = len(self.index.times)
        return DataError(
            f"{self.path}: frame {wanted} of {count} cannot be decoded (damaged file); {_HINT}"
        )


class _Pool:
    """The videos used last in this process."""

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Forgets everything: a forked process shares the file positions of its parent."""
        self.lock = threading.Lock()
        self.cursors: OrderedDict[tuple[str, tuple[int, int]], _Cursor] = OrderedDict()

    def take(self, path: str, index: _Index) -> _Cursor:
        """Takes a cursor out, so that one that fails is not used again."""
        return self.cursors.pop((path, index.stamp), None) or _Cursor(path, index)

    def keep(self, cursor: _Cursor) -> None:
        """Puts a cursor back, closing the one that has waited longest."""
        self.cursors[cursor.path, cursor.index.stamp] = cursor
        if len(self.cursors) > _MAX_OPEN:
            self.cursors.popitem(last=False)


_POOL = _Pool()
if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_POOL.reset)


def _open(path: str) -> Any:
    """Opens a video silently: errors are raised, not printed by OpenCV."""
    level = cv2.utils.logging.getLogLevel()
    cv2.utils.logging.setLogLevel(0)
    try:
        # One thread: the readers of a loader run side by side, and a fork would lose the others.
        capture = cv2.VideoCapture(path, cv2.CAP_FFMPEG, [cv2.CAP_PROP_N_THREADS, 1])
    finally:
        cv2.utils.logging.setLogLevel(level)
    if not capture.isOpened():
        if not Path(path).is_file():
            raise DataNotFoundError(f"{path}: no such file; correct the path")
        raise DataError(f"{path}: not a video, or truncated; {_HINT}")
    return capture


def _index(path: str) -> _Index:
    capture = _open(path)
    stat = Path(path).stat()
    shape = (
        int(capture.get(cv2.CAP_PROP_FRAME_HEIGHT)),
        int(capture.get(cv2.CAP_PROP_FRAME_WIDTH)),
    )
    rate = float(capture.get(cv2.CAP_PROP_FPS))
    announced = int(capture.get(cv2.CAP_PROP_FRAME_COUNT))
    _check_size(path, shape, announced)
    capture.set(cv2.CAP_PROP_FORMAT, -1)  # packets as they are, not decoded
    packets = []
    while capture.grab():
        is_key = capture.get(cv2.CAP_PROP_LRF_HAS_KEY_FRAME)
        packets.append((capture.get(cv2.CAP_PROP_POS_MSEC) / 1000, is_key))
        if len(packets) > MAX_FRAMES:
            _check_size(path, shape, len(packets))
    if not packets:
        raise DataError(f"{path}: a video without frames; {_HINT}")
    _check_complete(Path(path), announced, len(packets))
    seconds, is_key = np.array(packets).T
    order = np.argsort(seconds, kind="stable")
    times, keys = seconds[order], np.flatnonzero(is_key[order])
    if (np.diff(times) <= 0).any():
        times, keys = np.arange(len(times)) / rate, keys[:0]
    start = float(times[0])
    return _Index(shape, rate, start, times - start, keys, (stat.st_size, stat.st_mtime_ns))


def _check_size(path: str, shape: tuple[int, int], frames: int) -> None:
    height, width = shape
    if height * width > MAX_PIXELS or min(shape) < 1:
        raise DataError(
            f"{path}: a video of {width} x {height} pixels, where 1 to {MAX_PIXELS:,} in all are "
            "read; make it smaller: ffmpeg -i IN -vf scale=640:-2 OUT.mp4"
        )
    if frames > MAX_FRAMES:
        raise DataError(
            f"{path}: a video of {frames:,} frames, where {MAX_FRAMES:,} are the limit; cut it "
            "into parts: ffmpeg -i IN -f segment -segment_time 3600 -c copy OUT%03d.mp4"
        )


def _check_complete(path: Path, announced: int, counted: int) -> None:
    suffix = path.suffix.lower()
    if suffix in _COUNTED and counted < (1 - _MISSING) * announced:
        raise DataError(
            f"{path}: truncated: it announces {announced} frames and holds {counted}; {_HINT}"
        )
    if suffix == ".gif":
        with path.open("rb") as file:
            file.seek(-min(64, path.stat().st_size), os.SEEK_END)
            if not file.read().rstrip(b"\0\r\n ").endswith(b";"):
                raise DataError(f"{path}: truncated: the end mark is missing; {_HINT}")
