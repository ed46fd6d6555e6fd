"""Videos read by PyAV, for codecs unknown to OpenCV such as AV1."""

from __future__ import annotations

from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactileforge.data.frames.video_index import HINT, VideoIndex, check_size, spread_times
from tactileforge.errors import ConfigError, DataError
from tactileforge.util.origin import install_extra

#: Codecs opened but not decoded by builds of OpenCV: the FFmpeg in the wheels of opencv-python has
#: only a hardware decoder for AV1.
CODECS = frozenset({"av01"})


def is_missing() -> bool:
    """Whether PyAV is not installed."""
    return find_spec("av") is None


def missing_error(path: str, codec: str) -> ConfigError:
    """Error for a video of a codec of PyAV without PyAV."""
    return ConfigError(
        f"{path}: its codec is {codec}, which this OpenCV does not decode and PyAV does: "
        f"{install_extra('av')}"
    )


def read_stream(path: str, number: int) -> VideoIndex:
    """Index of one of several video streams of a file, by its packets.

    Args:
        path: Path of the file.
        number: Number of the stream among those of video, from 0.

    Raises:
        ConfigError: PyAV is not installed.
        DataError: There is no such stream, or it has no frames, more than 8 bits a channel, or
            more pixels or frames than are read.
    """
    if is_missing():
        raise ConfigError(
            f"{path}: stream: {number} needs PyAV: {install_extra('av')}; or write it to "
            f"a file of its own: ffmpeg -i IN -map 0:v:{number} -c copy OUT.mkv"
        )
    import av

    try:
        with av.open(path, metadata_errors="replace") as container:
            streams = container.streams.video
            if number >= len(streams):
                raise DataError(
                    f"{path}: stream: {number}, where the file has {len(streams)} of video, "
                    "counted from 0; correct it"
                )
            stream = streams[number]
            context = stream.codec_context
            if any(part.bits > 8 for part in getattr(context.format, "components", ())):
                raise DataError(f"{path}: stream {number} has more than 8 bits a channel")
            shape = (context.height, context.width)
            check_size(path, shape, stream.frames)
            packets = []
            for packet in container.demux(stream):
                # a packet without content ends the stream; an edit list hides others
                if packet.size and not getattr(packet, "is_discard", False):
                    packets.append(
                        (float((packet.pts or 0) * stream.time_base), packet.is_keyframe)
                    )
                    check_size(path, shape, len(packets))
            rate, codec = float(stream.average_rate or 0), context.codec_tag
    except (av.FFmpegError, OSError, UnicodeError) as error:
        raise DataError(f"{path}: stream {number} cannot be read ({error}); {HINT}") from error
    if not packets:
        raise DataError(f"{path}: stream {number} is without frames; {HINT}")
    seconds, is_key = np.array(packets).T
    order = np.argsort(seconds, kind="stable")
    times, keys = seconds[order], np.flatnonzero(is_key[order])
    if (np.diff(times) <= 0).any():
        times, keys = spread_times(times, rate), keys[:0]
    about, start = Path(path).stat(), float(times[0])
    return VideoIndex(
        shape, codec, rate, start, times - start, keys, (about.st_size, about.st_mtime_ns)
    )


class PyAvCursor:
    """A video open in PyAV with its current frame number.

    Args:
        path: Path of the file.
        index: Index of the video.
        number: Number of the stream among those of video.

    Raises:
        DataError: The first frame cannot be decoded.
        ConfigError: PyAV is not installed.
    """

    def __init__(self, path: str, index: VideoIndex, number: int = 0) -> None:
        if is_missing():
            raise missing_error(path, index.codec)
        self.path, self.index, self.number = path, index, number
        self._rewind()
        self.seekable = len(index.keys) > 0

    def _rewind(self) -> None:
        import av

        try:
            # a title that is not UTF-8 must not cost the frames
            self._container: Any = av.open(self.path, metadata_errors="replace")
            self._stream: Any = self._container.streams.video[self.number]
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
