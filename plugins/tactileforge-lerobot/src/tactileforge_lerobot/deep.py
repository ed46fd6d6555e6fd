"""Videos of 16 bits a channel, with values of touch as numbers, read by PyAV."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactileforge.errors import DataError, DataNotFoundError

#: Formats of 16 bits a channel, their numpy forms and channels.
_FORMATS = {
    f"{family}16{end}": form
    for family, form in (("gray", ("gray16le", 1)), ("gbrp", ("rgb48le", 3)))
    for end in ("le", "be")
}
#: Largest numbers of frames and of pixels of a frame.
_FRAMES, _PIXELS = 1 << 22, 1 << 26
#: Frames decoded in passing rather than by a seek.
_NEAR = 16


def form_of(path: Path) -> tuple[str, int] | None:
    """Numpy form and channels of a video of 16 bits a channel; None for any other file."""
    import av

    if not path.is_file():
        return None
    try:
        with av.open(str(path), metadata_errors="replace") as container:
            name = str(container.streams.video[0].codec_context.pix_fmt or "")
    except (av.FFmpegError, OSError, UnicodeError, IndexError):
        return None
    return _FORMATS.get(name)


class DeepVideo:
    """Numbers of a video of 16 bits a channel.

    Opening walks through the packets of the file without decoding one.

    Args:
        path: Path of the video.
        form: Numpy form and channels; see `form_of`.

    Attributes:
        times: Time of each frame since the first, s, float64 (T,).
        shape: Height and width.

    Raises:
        DataNotFoundError: There is no such file.
        DataError: It is damaged, or too large.
    """

    def __init__(self, path: Path, form: tuple[str, int]) -> None:
        import av

        if not path.is_file():
            raise DataNotFoundError(f"{path}: not there; download the data set again")
        self.path, self.name = path, str(path)
        self.form, self.channels = form
        try:
            with self._opened() as container:
                stream = container.streams.video[0]
                packets = [packet.pts for packet in container.demux(stream) if packet.size]
                unit = float(stream.time_base)
                self.shape = (int(stream.height), int(stream.width))
        except (av.FFmpegError, OSError, IndexError, TypeError) as error:
            raise self._damaged("its packets", error) from error
        if not 0 < self.shape[0] * self.shape[1] <= _PIXELS or len(packets) > _FRAMES:
            raise DataError(f"{path}: {len(packets)} frames of {self.shape}, which is too large")
        stamps = sorted(stamp for stamp in packets if stamp is not None)
        if len(stamps) != len(packets) or not stamps or len(set(stamps)) != len(stamps):
            raise DataError(f"{path}: frames without a time of their own; download it again")
        self.stamps = np.array(stamps, np.int64)
        self.times = (self.stamps - self.stamps[0]) * unit

    def _opened(self) -> Any:
        import av

        return av.open(str(self.path), metadata_errors="replace")

    def _damaged(self, what: str, error: Exception) -> DataError:
        return DataError(f"{self.path}: {what} cannot be decoded ({error}); download it again")

    def __len__(self) -> int:
        return len(self.stamps)

    def read(self, indices: Sequence[int]) -> NDArray[np.floating]:
        """Decodes frames, float32 (n, pixels, channels).

        Raises:
            DataError: A frame cannot be decoded.
        """
        height, width = self.shape
        out = np.empty((len(indices), height * width, self.channels), np.float32)
        wanted = {int(i) for i in indices}
        decoded = dict(self._decoded(sorted(wanted)))
        for place, i in enumerate(indices):
            out[place] = decoded[int(i)].reshape(height * width, self.channels)
        return out

    def _decoded(self, wanted: list[int]) -> Iterator[tuple[int, NDArray[np.uint16]]]:
        """Decodes frames in ascending order; seeks where they are far apart."""
        import av

        at = -_NEAR - 1
        try:
            with self._opened() as container:
                stream = container.streams.video[0]
                stream.codec_context.thread_count = 1
                frames = container.decode(stream)
                for number in wanted:
                    if number - at > _NEAR:
                        container.seek(int(self.stamps[number]), stream=stream)
                        frames = container.decode(stream)
                    yield number, self._until(frames, int(self.stamps[number]))
                    at = number
        except (av.FFmpegError, OSError, StopIteration, TypeError, ValueError) as error:
            raise self._damaged("a frame", error) from error

    def _until(self, frames: Iterator[Any], stamp: int) -> NDArray[np.uint16]:
        """Decodes up to the frame with a stamp."""
        for frame in frames:
            if frame.pts is not None and frame.pts >= stamp:
                if frame.pts != stamp or (frame.height, frame.width) != self.shape:
                    raise ValueError(f"at {frame.pts}: {frame.width} x {frame.height} pixels")
                return np.asarray(frame.to_ndarray(format=self.form), np.uint16)
        raise ValueError("the file ends before")


class DeepPart:
    """Consecutive frames of a video of 16 bits a channel.

    Args:
        video: The video.
        start: First frame.
        length: Number of frames.
    """

    def __init__(self, video: DeepVideo, start: int, length: int) -> None:
        self.video, self.start, self.length, self.name = video, start, length, video.name

    def __len__(self) -> int:
        return self.length

    def read(self, indices: Sequence[int]) -> NDArray[np.floating]:
        """Decodes frames; see `DeepVideo.read`."""
        return self.video.read([self.start + i for i in indices])
