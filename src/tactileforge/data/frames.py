"""Lazy frames: of a video, of image files, of an array. Nothing is decoded before it is asked for."""

from __future__ import annotations

import copy
import os
import threading
from collections import OrderedDict
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeAlias

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from tactileforge.errors import DataError, DataNotFoundError

#: Left, top, width and height of a part of a frame, in pixels.
Crop: TypeAlias = tuple[int, int, int, int]

VIDEO_SUFFIXES = frozenset({".avi", ".gif", ".m4v", ".mkv", ".mov", ".mp4", ".mpg", ".ts", ".webm"})

#: Containers whose header counts frames; others estimate the count from a duration.
_COUNTED = frozenset({".avi", ".m4v", ".mov", ".mp4"})
#: Share of the announced frames that may be missing before a file counts as truncated.
_MISSING = 0.05
#: Videos that one process keeps open.
_MAX_OPEN = 8
#: OpenCV looks for a key frame at least this many frames before the one it seeks.
_SEEK_MARGIN = 16

_HINT = "download it again, or convert it: ffmpeg -i IN -c:v libx264 OUT.mp4"


class _Cropped:
    """Frames of one size, of which a part may be shown."""

    def __init__(self, name: str, size: tuple[int, int], crop: Crop | None) -> None:
        self._name = name
        self.full_shape = size
        self._crop = _checked(crop, size, name)

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width."""
        _, _, width, height = self._crop
        return height, width

    def crop(self, box: Crop) -> Any:
        """The same frames, of which another part of the full frame is shown; nothing is read."""
        other = copy.copy(self)
        other._crop = _checked(box, self.full_shape, self._name)
        return other

    def _show(self, frame: NDArray[np.uint8]) -> NDArray[np.uint8]:
        left, top, width, height = self._crop
        return frame[top : top + height, left : left + width]


class VideoFrames(_Cropped):
    """Frames of a video file.

    Opening walks through the packets of the file without decoding one: that gives the true number of
    frames (headers may announce more) and their times, also where the rate varies. Reading steps forward
    inside the codec, and seeks where that saves work; a seek counts only if the time of the frame that it
    lands on proves its number, else the video is read from its start.

    Args:
        path: The file.
        crop: Left, top, width, height in pixels; None shows everything.

    Raises:
        DataNotFoundError: There is no such file.
        DataError: It is no video, is truncated, or the crop lies outside its frames.
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
        _check_range(indices, len(self), self.path)
        out = np.empty((len(indices), *self.shape, 3), np.uint8)
        with _POOL.lock:
            cursor = _POOL.take(self.path, self._index)
            for place in np.argsort(indices, kind="stable"):
                frame = self._show(cursor.frame(int(indices[place])))
                out[place] = cv2.cvtColor(frame, cv2.COLOR_BGR2RGB)
            _POOL.keep(cursor)
        return out


class ImageFrames(_Cropped):
    """Image files, one frame each, of one size.

    Opening reads the headers only.

    Args:
        paths: The files, oldest first.
        crop: Left, top, width, height in pixels; None shows everything.

    Raises:
        DataNotFoundError: A file does not exist.
        DataError: A file is no 8-bit image, or its size differs from that of the first.
    """

    def __init__(self, paths: Sequence[str | Path], crop: Crop | None = None) -> None:
        self.paths = [str(path) for path in paths]
        if not self.paths:
            raise DataError("an image sequence without images")
        sizes = [_image(path, decode=False)[0] for path in self.paths]
        for path, size in zip(self.paths, sizes, strict=True):
            if size != sizes[0]:
                raise DataError(
                    f"{path}: {_size(size)} pixels, but {self.paths[0]} has {_size(sizes[0])}: frames of "
                    "one recording have one size; move the file out, or resize it"
                )
        super().__init__(self.paths[0], sizes[0], crop)

    def __len__(self) -> int:
        return len(self.paths)

    def read(self, indices: Sequence[int]) -> NDArray[np.uint8]:
        """Decodes; see `contracts.Frames.read`."""
        _check_range(indices, len(self), self.paths[0])
        out = np.empty((len(indices), *self.shape, 3), np.uint8)
        for place, i in enumerate(indices):
            size, frame = _image(self.paths[i], decode=True)
            if size != self.full_shape:
                raise DataError(f"{self.paths[i]}: its size has changed to {_size(size)} pixels")
            out[place] = self._show(frame)
        return out


class ArrayFrames:
    """Frames that are in memory already.

    Args:
        array: uint8 (T, H, W, 3), RGB.

    Raises:
        DataError: The array is not of that type and shape.
    """

    def __init__(self, array: NDArray[np.uint8]) -> None:
        if array.dtype != np.uint8 or array.ndim != 4 or array.shape[-1] != 3:
            raise DataError(f"frames are uint8 (T, H, W, 3), not {array.dtype} {array.shape}")
        self.array = array

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width."""
        return int(self.array.shape[1]), int(self.array.shape[2])

    def __len__(self) -> int:
        return len(self.array)

    def read(self, indices: Sequence[int]) -> NDArray[np.uint8]:
        """Copies; see `contracts.Frames.read`."""
        _check_range(indices, len(self), "array")
        return self.array[list(indices)]


@dataclass(frozen=True)
class _Index:
    """What the packets of a video say.

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

    def worth_seeking(self, at: int, wanted: int) -> bool:
        """Whether a key frame lies between here and there, so that a seek skips decoding."""
        if wanted < at:
            return True
        before = int(np.searchsorted(self.keys, wanted - _SEEK_MARGIN, side="right")) - 1
        return before >= 0 and int(self.keys[before]) > at + 1

    def number(self, seconds: float) -> int | None:
        """The frame that has this time in the file."""
        seconds -= self.start
        i = int(np.searchsorted(self.times, seconds - 5e-4))
        found = i < len(self.times) and abs(float(self.times[i]) - seconds) < 5e-4
        return i if found else None


class _Cursor:
    """An open video that knows which frame it stands on."""

    def __init__(self, path: str, index: _Index) -> None:
        self.path = path
        self.index = index
        self._rewind()

    def _rewind(self) -> None:
        self.capture = _open(self.path)
        self.at = -1

    def frame(self, wanted: int) -> NDArray[np.uint8]:
        """Decodes a frame: uint8 (H, W, 3), BGR."""
        if self.index.worth_seeking(self.at, wanted) and not self._seek(wanted):
            self._rewind()
        while self.at < wanted:
            if not self.capture.grab():
                raise self._damaged(wanted)
            self.at += 1
        good, frame = self.capture.retrieve()
        if not good:
            raise self._damaged(wanted)
        if frame.shape[:2] != self.index.shape:
            raise DataError(
                f"{self.path}: frame {wanted} has {_size(frame.shape[:2])} pixels, the first frame "
                f"{_size(self.index.shape)}: frames of one recording have one size; split the file"
            )
        out: NDArray[np.uint8] = frame
        return out

    def _seek(self, wanted: int) -> bool:
        """Lands on the frame or before it; false where that cannot be proven."""
        if not len(self.index.keys):
            return False
        seconds = self.index.start + float(self.index.times[wanted])
        self.capture.set(cv2.CAP_PROP_POS_FRAMES, round(seconds * self.index.rate))
        if not self.capture.grab():
            return False
        landed = self.index.number(self.capture.get(cv2.CAP_PROP_POS_MSEC) / 1000)
        if landed is None or landed > wanted:
            return False
        self.at = landed
        return True

    def _damaged(self, wanted: int) -> DataError:
        count = len(self.index.times)
        return DataError(
            f"{self.path}: frame {wanted} of {count} cannot be decoded, the file is damaged; {_HINT}"
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
    """Opens a video. FFmpeg's and OpenCV's own messages are silenced: errors are raised here."""
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")
    level = cv2.getLogLevel()
    cv2.setLogLevel(0)
    try:
        # One thread: the readers of a loader run side by side, and a fork would lose the others.
        capture = cv2.VideoCapture(path, cv2.CAP_FFMPEG, [cv2.CAP_PROP_N_THREADS, 1])
    finally:
        cv2.setLogLevel(level)
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
    capture.set(cv2.CAP_PROP_FORMAT, -1)  # packets as they are, not decoded
    packets = []
    while capture.grab():
        is_key = capture.get(cv2.CAP_PROP_LRF_HAS_KEY_FRAME)
        packets.append((capture.get(cv2.CAP_PROP_POS_MSEC) / 1000, is_key))
    if not packets:
        raise DataError(f"{path}: a video without frames; {_HINT}")
    if Path(path).suffix.lower() in _COUNTED and len(packets) < (1 - _MISSING) * announced:
        raise DataError(
            f"{path}: truncated: it announces {announced} frames and holds {len(packets)}; {_HINT}"
        )
    seconds, is_key = np.array(packets).T
    order = np.argsort(seconds, kind="stable")
    times, keys = seconds[order], np.flatnonzero(is_key[order])
    if (np.diff(times) <= 0).any():
        times, keys = np.arange(len(times)) / rate, keys[:0]
    start = float(times[0])
    return _Index(shape, rate, start, times - start, keys, (stat.st_size, stat.st_mtime_ns))


def _image(path: str, decode: bool) -> tuple[tuple[int, int], NDArray[np.uint8]]:
    """Height and width of an image file, and its pixels if asked for."""
    try:
        with Image.open(path) as image:
            if image.mode[0] in "IF":
                raise DataError(f"{path}: {image.mode} pixels; convert it to 8 bits a channel")
            pixels = np.asarray(image.convert("RGB")) if decode else np.empty(0, np.uint8)
            return (image.height, image.width), pixels
    except FileNotFoundError:
        raise DataNotFoundError(f"{path}: no such file; correct the path") from None
    except (OSError, SyntaxError, ValueError) as error:
        raise DataError(f"{path}: not a readable image ({error}); download it again") from error


def _checked(crop: Crop | None, size: tuple[int, int], name: str) -> Crop:
    height, width = size
    left, top, wide, high = crop or (0, 0, width, height)
    if min(left, top) < 0 or min(wide, high) < 1 or left + wide > width or top + high > height:
        raise DataError(
            f"{name}: the crop {list(crop or ())} (left, top, width, height) lies outside its "
            f"{_size(size)} pixels; correct the crop"
        )
    return left, top, wide, high


def _check_range(indices: Sequence[int], count: int, name: str) -> None:
    for i in indices:
        if not 0 <= i < count:
            raise IndexError(f"{name}: frame {i} of {count}")


def _size(shape: Sequence[int]) -> str:
    """Width x height, as people say it."""
    return f"{shape[1]}x{shape[0]}"
