"""Index of a video: size, rate and times of its frames, read without decoding one."""

from __future__ import annotations

import os
import re
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from tactileforge.data.frames.avi_tail import avi_tail
from tactileforge.data.frames.mp4_edits import shown_share
from tactileforge.errors import DataError, DataNotFoundError, in_utf8
from tactileforge.util.pointers import check_pointer
from tactileforge.util.untrusted import MAX_PIXELS

# OpenCV reads this once, when the process first opens a video. FFmpeg's messages name no file, and
# would stand between those of a run.
os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")

#: Containers with a count of frames in their header; for others FFmpeg estimates it from a
#: duration.
_COUNTED = frozenset({".avi", ".m4v", ".mov", ".mp4"})
#: FFmpeg's address of a part of a file (ffmpeg-protocols, subfile).
_INSIDE = re.compile(r"subfile,,start,(\d+),end,(\d+),,:(.+)", re.DOTALL)
#: Largest share of missing frames of a file that does not count as truncated.
_MISSING = 0.05
#: OpenCV seeks to a key frame at least this many frames before the requested one (first ``delta``
#: of ``CvCapture_FFMPEG::seek``), so nearer key frames save nothing.
_SEEK_MARGIN = 16
#: Frames per second of a video without times and without a rate: implausible on purpose, so that
#: `video_clock.video_times` asks for a rate.
_NO_RATE = 1e6
#: Most bytes behind the end of an AVI file.
_MAX_TAIL = 1 << 26
#: Largest number of frames of a video: 38 hours at 30 a second.
MAX_FRAMES = 1 << 22

#: First or last byte of FFmpeg's code of a pixel format of 16 bits (libavcodec, raw.c).
_DEEP = 16

#: Hint for images in place of a video.
_IMAGES = (
    "open images as frames: tactileforge.data.ImageFrames(sorted(Path(DIR)"
    '.glob("*.png"))), and give their times'
)
#: Hint for a damaged video.
HINT = "download it again, or convert it: ffmpeg -i IN -c:v libx264 OUT.mp4"


@dataclass(frozen=True)
class VideoIndex:
    """Index of a video, read from its packets.

    Attributes:
        shape: Height and width, pixels.
        codec: Four letters of the codec, in lower case.
        rate: Frames per second, used by OpenCV to turn frame numbers into times.
        start: Time of the first frame in the file, s.
        times: float64 (T,), seconds since the first frame.
        keys: int64 (k,), frame numbers of the key frames; empty for a file without seeking.
        stamp: Size and time of change of the file.
    """

    shape: tuple[int, int]
    codec: str
    rate: float
    start: float
    times: NDArray[np.float64]
    keys: NDArray[np.int64]
    stamp: tuple[int, int]

    def skips(self, at: int, number: int) -> bool:
        """Whether a seek saves decoding: a key frame lies between two frames."""
        before = int(np.searchsorted(self.keys, number - _SEEK_MARGIN, side="right")) - 1
        return before >= 0 and int(self.keys[before]) > at + 1

    def damaged(self, path: str, number: int) -> DataError:
        """Error for an undecodable frame."""
        return DataError(
            f"{path}: frame {number} of {len(self.times)} cannot be decoded (damaged file); {HINT}"
        )

    def number(self, seconds: float) -> int | None:
        """Number of the frame with a time in the file, s; None without one."""
        seconds -= self.start
        # half a millisecond: OpenCV and some containers round times to milliseconds
        i = int(np.searchsorted(self.times, seconds - 5e-4))
        is_there = i < len(self.times) and abs(float(self.times[i]) - seconds) < 5e-4
        return i if is_there else None


def video_inside(path: str, start: int, size: int) -> str:
    """Address of a video inside of another file, such as a tar, in place of a path.

    Args:
        path: Path of the other file.
        start: Position of the first byte of the video.
        size: Bytes of the video.
    """
    return f"subfile,,start,{start},end,{start + size},,:{os.path.abspath(path)}"


def _outer(path: str) -> Path:
    """The file of a path, or of an address of `inside`."""
    found = _INSIDE.fullmatch(path)
    return Path(found[3] if found else path)


def open_video(path: str) -> Any:
    """Open a video silently: errors are raised, not printed by OpenCV.

    Raises:
        DataNotFoundError: There is no such file.
        DataError: The path is a folder, or no video.
    """
    if in_utf8(path) != path:  # OpenCV ends the process
        raise DataError(f"{path!a}: its name is not UTF-8; rename the file or folder")
    _check_file(path)
    _check_tail(path)
    # one level for all of the process, so that it is put back
    level = cv2.utils.logging.getLogLevel()
    cv2.utils.logging.setLogLevel(0)
    try:
        # One thread: the readers of a loader run side by side, and a fork would lose the others.
        capture = cv2.VideoCapture(path, cv2.CAP_FFMPEG, [cv2.CAP_PROP_N_THREADS, 1])
    finally:
        cv2.utils.logging.setLogLevel(level)
    if not capture.isOpened():
        found = _INSIDE.fullmatch(path)
        check_pointer(_outer(path), int(found[1]) if found else 0)
        raise DataError(f"{path}: not a video, or truncated; {HINT}")
    return capture


def _check_file(path: str) -> None:
    """Check for a file, as OpenCV takes patterns of images and URLs as well."""
    with suppress(OSError):  # a name too long for the file system
        if _outer(path).is_file():
            return
        if Path(path).is_dir():
            raise DataError(f"{path}: a folder, not a video; {_IMAGES}")
    if "%" in Path(path).name:
        raise DataNotFoundError(f"{path}: no such file, and no pattern of images; {_IMAGES}")
    raise DataNotFoundError(f"{path}: no such file; correct the path")


def _check_tail(path: str) -> None:
    """Check for bytes behind the end of the file, to be searched for frames one by one."""
    found = _INSIDE.fullmatch(path)
    start = int(found[1]) if found else 0
    tail = avi_tail(_outer(path), start, int(found[2]) - start if found else None)
    if tail > _MAX_TAIL:
        raise DataError(f"{path}: {tail} bytes behind its end; {HINT}")


def read_index(path: str) -> VideoIndex:
    """Walk through the packets of a video; see `video.VideoFrames`."""
    capture = open_video(path)
    stat = _outer(path).stat()
    shape = (
        int(capture.get(cv2.CAP_PROP_FRAME_HEIGHT)),
        int(capture.get(cv2.CAP_PROP_FRAME_WIDTH)),
    )
    letters = int(capture.get(cv2.CAP_PROP_FOURCC)).to_bytes(4, "little", signed=True)
    codec = letters.decode("ascii", "replace").lower()
    rate = float(capture.get(cv2.CAP_PROP_FPS))
    announced = int(capture.get(cv2.CAP_PROP_FRAME_COUNT))
    # before any packet is read: a header may announce years
    check_size(path, shape, announced)
    _check_depth(path, int(capture.get(cv2.CAP_PROP_CODEC_PIXEL_FORMAT)))
    capture.set(cv2.CAP_PROP_FORMAT, -1)  # raw packets, not decoded
    packets = []
    while capture.grab():
        is_key = capture.get(cv2.CAP_PROP_LRF_HAS_KEY_FRAME)
        packets.append((capture.get(cv2.CAP_PROP_POS_MSEC) / 1000, is_key))
        if len(packets) > MAX_FRAMES:
            check_size(path, shape, len(packets))
    if not packets:
        raise DataError(f"{path}: a video without frames; {HINT}")
    shown = _shown_share(path) * announced
    _check_complete(Path(path), round(shown), len(packets))
    # packets come in the order of decoding: with B frames, that is not the order of showing
    seconds, is_key = np.array(packets).T
    order = np.argsort(seconds, kind="stable")
    times, keys = seconds[order], np.flatnonzero(is_key[order])
    if (np.diff(times) <= 0).any():
        # without unique times a seek could not be verified: no keys, so none is tried
        times, keys = spread_times(times, rate), keys[:0]
    # packets that an edit list hides: only a decoder tells which ones
    if 0 < shown < min(announced, len(packets)) - 0.5 and len(seen := _shown_times(path)):
        _check_complete(Path(path), round(shown), len(seen))
        times, keys = seen, keys[:0]
    start = float(times[0])
    return VideoIndex(
        shape, codec, rate, start, times - start, keys, (stat.st_size, stat.st_mtime_ns)
    )


def _shown_share(path: str) -> float:
    found = _INSIDE.fullmatch(path)
    if found:
        start, end = int(found[1]), int(found[2])
        return shown_share(Path(found[3]), start, end - start)
    return shown_share(Path(path)) if Path(path).suffix.lower() in _COUNTED else 1.0


def _shown_times(path: str) -> NDArray[np.float64]:
    """Times of the shown frames, float64 (T,), s; empty without a decoded one."""
    capture, times = open_video(path), list[float]()
    while capture.grab() and len(times) < MAX_FRAMES:
        times.append(capture.get(cv2.CAP_PROP_POS_MSEC) / 1000)
    return np.array(times)


def spread_times(times: NDArray[np.float64], rate: float) -> NDArray[np.float64]:
    """Spread repeated times evenly between their neighbours.

    If most are repeated, the file has no times, and the rate gives them.
    """
    rows = np.arange(len(times))
    new = np.diff(times, prepend=-np.inf) > 0
    if 2 * new.sum() <= len(times):
        return rows / (rate if np.isfinite(rate) and rate > 0 else _NO_RATE)
    # the last ones have no later neighbour: one usual step stands for it
    period = float(np.median(np.diff(times[new])))
    known = np.append(rows[new], len(times))
    out: NDArray[np.float64] = np.interp(rows, known, np.append(times[new], times[-1] + period))
    return out


def check_size(path: str, shape: tuple[int, int], frames: int) -> None:
    """Raises a `DataError` for more pixels or frames than are read."""
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
    """Check for at most 8 bits a channel: of 16, OpenCV would show the upper byte alone."""
    letters = pixel_format.to_bytes(4, "little", signed=pixel_format < 0)
    if _DEEP in (letters[0], letters[3]):
        raise DataError(
            f"{path}: 16 bits a channel; convert it to 8 bits a channel, scaled by what the camera "
            "calls white"
        )


def _check_complete(path: Path, announced: int, counted: int) -> None:
    suffix = path.suffix.lower()
    is_counted = suffix in _COUNTED or _INSIDE.fullmatch(str(path))
    if is_counted and counted < (1 - _MISSING) * announced:
        raise DataError(
            f"{path}: truncated: it announces {announced} frames and holds {counted}; {HINT}"
        )
    # a GIF has no count of frames, but ends with a trailer, the byte 0x3B (GIF89a, section 27)
    if suffix == ".gif":
        with path.open("rb") as file:
            file.seek(-min(64, path.stat().st_size), os.SEEK_END)
            if not file.read().rstrip(b"\0\r\n ").endswith(b";"):
                raise DataError(f"{path}: truncated: the end mark is missing; {HINT}")
