"""Frames of videos inside of tables."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache
from io import BytesIO

import numpy as np
from numpy.typing import NDArray

from tactileforge.errors import DataError


class TableVideo:
    """A video in the bytes of a table; decoded as a whole when it is read, as it is short.

    Args:
        read: Function for the bytes, picklable.
        length: Number of frames; what the video has beyond it is padding.
        where: File, and place in it, for messages.

    Raises:
        DataError: The video is damaged, or has fewer frames; raised by reading.
    """

    def __init__(self, read: Callable[[], bytes], length: int, where: str) -> None:
        self._read, self._length, self.where = read, length, where

    def __len__(self) -> int:
        return self._length

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width."""
        height, width = self._decoded().shape[1:3]
        return int(height), int(width)

    def read(self, indices: Sequence[int]) -> NDArray[np.uint8]:
        """Decodes; uint8 (n, H, W, 3), RGB."""
        frames = self._decoded()
        if any(not 0 <= i < self._length for i in indices):
            raise IndexError(f"{self.where}: frames {list(indices)} of {self._length}")
        return frames[list(indices)]

    def _decoded(self) -> NDArray[np.uint8]:
        frames = _decode(self._read(), self.where)
        if len(frames) < self._length:
            raise DataError(
                f"{self.where}: the video has {len(frames)} frames, the table {self._length}; "
                "download it again"
            )
        return frames


@lru_cache(maxsize=4)
def _decode(content: bytes, where: str) -> NDArray[np.uint8]:
    import av

    try:
        with av.open(BytesIO(content)) as file:
            frames = [frame.to_ndarray(format="rgb24") for frame in file.decode(video=0)]
    except (av.error.FFmpegError, IndexError) as error:
        raise DataError(f"{where}: no readable video ({error}); download it again") from error
    if not frames:
        raise DataError(f"{where}: a video without frames; download it again")
    out: NDArray[np.uint8] = np.stack(frames)
    return out
