"""Lazy frames of arrays and videos inside of a tar."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from tactileforge.data import (
    Blob,
    VideoFrames,
    channel_fix,
    check_range,
    size_text,
    video_inside,
    video_times,
)
from tactileforge.errors import DataError
from tactileforge.plugins import MAX_PIXELS
from tactileforge_datasets.samples.places import array_header


class ArrayRows:
    """Pictures of arrays in a tar; a clip reads its own rows alone.

    Args:
        name: Name of the recording, for messages.
        blobs: Arrays of uint8, (H, W, 3) or (T, H, W, 3), one after another.

    Raises:
        DataError: An array holds no pictures, or pictures of another size.
    """

    def __init__(self, name: str, blobs: Sequence[Blob]) -> None:
        self.name, self.path = name, blobs[0].path
        starts: list[NDArray[np.int64]] = []
        self.shape = (0, 0)
        for number, blob in enumerate(blobs):
            where = name if len(blobs) == 1 else f"{name}, frame {number}"
            dtype, shape, fortran, start = array_header(blob, where)
            fits = dtype == np.uint8 and len(shape) in (3, 4) and shape[-1] == 3
            if fortran or not fits or 0 in shape:
                order = ", columns first" if fortran else ""
                raise DataError(
                    f"{where}: {dtype} {shape}{order}, where uint8 (T, H, W, 3) or (H, W, 3) "
                    f"belongs{channel_fix(shape)}"
                )
            # by the header alone, before anything of that size is read
            size = shape[-3], shape[-2]
            if size[0] * size[1] > MAX_PIXELS or (number and size != self.shape):
                raise DataError(
                    f"{where}: {size_text(size)} pixels, where the first has "
                    f"{size_text(self.shape)} and {MAX_PIXELS:,} are the limit"
                )
            self.shape = size
            rows = np.arange(1 if len(shape) == 3 else shape[0], dtype=np.int64)
            starts.append(blob.offset + start + rows * size[0] * size[1] * 3)
        self.starts = np.concatenate(starts)

    def __len__(self) -> int:
        return len(self.starts)

    def read(self, indices: Sequence[int]) -> NDArray[np.uint8]:
        """Read frames; see `contracts.Frames.read`."""
        check_range(indices, len(self), self.name)
        out = np.empty((len(indices), *self.shape, 3), np.uint8)
        size = out[0].size if len(out) else 0
        for place, i in enumerate(indices):
            raw = Blob(self.path, int(self.starts[i]), size).read()
            out[place] = np.frombuffer(raw, np.uint8).reshape(out.shape[1:])
        return out


class TarVideo:
    """Frames of a video, decoded inside its tar.

    Args:
        name: Name of the part, for messages.
        blob: Place of the video.

    Raises:
        DataError: The video is damaged or too large, as for `VideoFrames`.
    """

    def __init__(self, name: str, blob: Blob) -> None:
        self.name, self._place = name, video_inside(blob.path, blob.offset, blob.size)
        try:
            self._frames = VideoFrames(self._place)
        except DataError as error:
            raise self._named(error) from error

    def times(self, fix: str) -> NDArray[np.float64]:
        """Times of the frames, float64 (T,), s; see `video_times`."""
        try:
            return video_times(self._frames, fix)
        except DataError as error:
            raise self._named(error) from error

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width, pixels."""
        return self._frames.shape

    def __len__(self) -> int:
        return len(self._frames)

    def read(self, indices: Sequence[int]) -> NDArray[np.uint8]:
        """Decode frames; see `contracts.Frames.read`."""
        try:
            return self._frames.read(indices)
        except DataError as error:
            raise self._named(error) from error

    def _named(self, error: DataError) -> DataError:
        # the address of a part of a file means nothing to a reader
        return DataError(str(error).replace(self._place, self.name))
