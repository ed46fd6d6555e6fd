"""Facts of a video, read from its packets without decoding one."""

from __future__ import annotations

import os
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from tactileforge.errors import DataError, DataNotFoundError
from tactileforge.untrusted import MAX_PIXELS

# FFmpeg reads this once, when the process first opens a video. Its messages name no file.
os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")

#: Containers whose header counts frames; others estimate the count from a duration.
_COUNTED = frozenset({".avi", ".m4v", ".mov", ".mp4"})
#: Share of the announced frames that may be missing before a file counts as truncated.
_MISSING = 0.05
#: OpenCV looks for a key frame at least this many frames before the one it seeks.
_SEEK_MARGIN = 16
#: Frames per second of a video without times and without a rate: as no camera has it,
#: `video_clock.video_times` asks for one.
_NO_RATE = 1e6
#: Frames of a video: 38 hours at 30 a second.
MAX_FRAMES = 1 << 22

#: Number that FFmpeg's letters of a pixel format of 16 bits begin or end with.
_DEEP = 16

#: How images are read as a video.
_IMAGES = (
    "open images as frames: tactileforge.data.frames.lazy.ImageFrames(sorted(Path(DIR)"
    '.glob("*.png"))), and give their times'
)
#: What is done about a damaged video.
HINT = "download it again, or convert it: ffmpeg -i IN -c:v libx264 OUT.mp4"


@dataclass(frozen=True)
class VideoIndex:
    """Facts of a video, read from its packets.

    Attributes:
        shape: Height and width.
        codec: Its four letters, in lower case.
        rate: Frames per second, by which OpenCV turns frame numbers into times.
        start: Time of the first frame in the file, s.
        times: float64 (T,), seconds since then.
        keys: Frame numbers of the key frames; none where seeking is not possible.
        stamp: Size and time of change of the file.
    """

    shape: tuple[int, int]
    codec: str
    rate: float
    start: float
    times: NDArray[np.float64]
    keys: NDArray[np.int64]
    stamp: tuple[int, int]

    def skips(self, at: int, wanted: int) -> bool:
        """Whether a key frame lies between the two, so that a seek saves decoding."""
        before = int(np.searchsorted(self.keys, wanted - _SEEK_MARGIN, side="right")) - 1
        return before >= 0 and int(self.keys[before]) > at + 1

    def damaged(self, path: str, number: int) -> DataError:
        """Error of a frame that cannot be decoded."""
        return DataError(
            f"{path}: frame {number} of {len(self.times)} cannot be decoded (damaged file); {HINT}"
        )

    def number(self, seconds: float) -> int | None:
        """Number of the frame with this time in the file; None where there is none."""
        seconds -= self.start
        i = int(np.searchsorted(self.times, seconds - 5e-4))
        is_there = i < len(self.times) and abs(float(self.times[i]) - seconds) < 5e-4
        return i if is_there else None


def open_video(path: str) -> Any:
    """Opens a video silently: errors are raised, not printed by OpenCV.

    Raises:
        DataNotFoundError: There is no such file.
        DataError: It is a folder, or no video.
    """
    _check_file(path)
    level = cv2.utils.logging.getLogLevel()
    cv2.utils.logging.setLogLevel(0)
    try:
        # One thread: the readers of a loader run side by side, and a fork would lose the others.
        capture = cv2.VideoCapture(path, cv2.CAP_FFMPEG, [cv2.CAP_PROP_N_THREADS, 1])
    finally:
        cv2.utils.logging.setLogLevel(level)
    if not capture.isOpened():
        raise DataError(f"{path}: not a video, or truncated; {HINT}")
    return capture


def _check_file(path: str) -> None:
    """Raises an error where there is no file: OpenCV takes patterns of images and URLs as well."""
    with suppress(OSError):  # a name that is too long is none
        if Path(path).is_file():
            return
        if Path(path).is_dir():
            raise DataError(f"{path}: a folder, not a video; {_IMAGES}")
    if "%" in Path(path).name:
        raise DataNotFoundError(f"{path}: no such file, and no pattern of images; {_IMAGES}")
    raise DataNotFoundError(f"{path}: no such file; correct the path")


def read_index(path: str) -> VideoIndex:
    """Walks through the packets of a video; see `video.VideoFrames`."""
    capture = open_video(path)
    stat = Path(path).stat()
    shape = (
        int(capture.get(cv2.CAP_PROP_FRAME_HEIGHT)),
        int(capture.get(cv2.CAP_PROP_FRAME_WIDTH)),
    )
    letters = int(capture.get(cv2.CAP_PROP_FOURCC)).to_bytes(4, "little", signed=True)
    codec = letters.decode("ascii", "replace").lower()
    rate = float(capture.get(cv2.CAP_PROP_FPS))
    announced = int(capture.get(cv2.CAP_PROP_FRAME_COUNT))
    _check_size(path, shape, announced)
    _check_depth(path, int(capture.get(cv2.CAP_PROP_CODEC_PIXEL_FORMAT)))
    capture.set(cv2.CAP_PROP_FORMAT, -1)  # packets as they are, not decoded
    packets = []
    while capture.grab():
        is_key = capture.get(cv2.CAP_PROP_LRF_HAS_KEY_FRAME)
        packets.append((capture.get(cv2.CAP_PROP_POS_MSEC) / 1000, is_key))
        if len(packets) > MAX_FRAMES:
            _check_size(path, shape, len(packets))
    if not packets:
        raise DataError(f"{path}: a video without frames; {HINT}")
    _check_complete(Path(path), announced, len(packets))
    seconds, is_key = np.array(packets).T
    order = np.argsort(seconds, kind="stable")
    times, keys = seconds[order], np.flatnonzero(is_key[order])
    if (np.diff(times) <= 0).any():
        times, keys = _apart(times, rate), keys[:0]
    start = float(times[0])
    return VideoIndex(
        shape, codec, rate, start, times - start, keys, (stat.st_size, stat.st_mtime_ns)
    )


def _apart(times: NDArray[np.float64], rate: float) -> NDArray[np.float64]:
    """Times of which some are there twice: such a frame is between its neighbours.

    Where most are, the file has no times, and the rate gives them.
    """
    rows = np.arange(len(times))
    new = np.diff(times, prepend=-np.inf) > 0
    if 2 * new.sum() <= len(times):
        return rows / (rate if np.isfinite(rate) and rate > 0 else _NO_RATE)
    period = float(np.median(np.diff(times[new])))
    known = np.append(rows[new], len(times))
    out: NDArray[np.float64] = np.interp(rows, known, np.append(times[new], times[-1] + period))
    return out


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


def _check_depth(path: str, pixel_format: int) -> None:
    """Raises an error for 16 bits a channel: the codec would show the upper byte alone."""
    letters = pixel_format.to_bytes(4, "little", signed=pixel_format < 0)
    if _DEEP in (letters[0], letters[3]):
        raise DataError(
            f"{path}: 16 bits a channel; convert it to 8 bits a channel, scaled by what the camera "
            "calls white"
        )


def _check_complete(path: Path, announced: int, counted: int) -> None:
    suffix = path.suffix.lower()
    if suffix in _COUNTED and counted < (1 - _MISSING) * announced:
        raise DataError(
            f"{path}: truncated: it announces {announced} frames and holds {counted}; {HINT}"
        )
    if suffix == ".gif":
        with path.open("rb") as file:
            file.seek(-min(64, path.stat().st_size), os.SEEK_END)
            if not file.read().rstrip(b"\0\r\n ").endswith(b";"):
                raise DataError(f"{path}: truncated: the end mark is missing; {HINT}")
