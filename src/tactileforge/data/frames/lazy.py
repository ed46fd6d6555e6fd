"""Lazy frames of image files and arrays, decoded on demand."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

import numpy as np
from numpy.typing import NDArray

from tactileforge.data.frames.crop import Crop, Cropped, check_range, size_text
from tactileforge.data.frames.picture_files import (
    check_depth,
    check_single,
    orientation,
    rgb_pixels,
    upright_size,
)
from tactileforge.data.frames.picture_index import ImageHeader, PictureIndex
from tactileforge.data.frames.pixel_contract import channel_fix, value_fix
from tactileforge.data.frames.video import VIDEO_SUFFIXES, VideoFrames
from tactileforge.errors import DataError, DataNotFoundError
from tactileforge.util.pointers import check_pointer
from tactileforge.util.untrusted import open_picture

if TYPE_CHECKING:
    from PIL import Image

T = TypeVar("T")

__all__ = ["VIDEO_SUFFIXES", "ArrayFrames", "Crop", "ImageFrames", "VideoFrames"]


class ImageFrames(Cropped):
    """Image files of one size, one frame each.

    Opening reads the headers only; decoding checks size and depth again.

    Args:
        paths: Paths of the files, oldest first.
        crop: Left, top, width, height in pixels; None shows everything.
        index: Headers that are known from an earlier start; None reads each.
        white: Value of white of grey images of 16 bits; None where there are none.

    Attributes:
        tagged: Number of images that their EXIF orientation turns or mirrors.

    Raises:
        DataNotFoundError: A file does not exist.
        DataError: A file is no 8-bit image, or differs in size from the first; on reading, also a
            file with transparent pixels.

    Example:
        >>> from tactileforge.data import encode_image
        >>> _ = Path("0.png").write_bytes(encode_image(np.zeros((240, 320, 3), np.uint8), "png"))
        >>> ImageFrames(["0.png"], crop=(10, 20, 100, 50)).read([0]).shape
        (1, 50, 100, 3)
    """

    def __init__(
        self,
        paths: Sequence[str | Path],
        crop: Crop | None = None,
        index: PictureIndex | None = None,
        white: float | None = None,
    ) -> None:
        self.paths, self.white = [str(path) for path in paths], white
        if not self.paths:
            raise DataError("an image sequence without images")
        head = partial(_head, white=white)
        heads = index.heads(self.paths, head) if index else [*map(head, self.paths)]
        sizes = [(head.height, head.width) for head in heads]
        self.tagged = sum(head.is_turned for head in heads)
        for path, size in zip(self.paths, sizes, strict=True):
            if size != sizes[0]:
                raise DataError(
                    f"{path} has {size_text(size)} pixels, {self.paths[0]} {size_text(sizes[0])}: "
                    "frames of one recording have one size; move the file out, or resize it"
                )
        super().__init__(self.paths[0], sizes[0], crop)

    def __len__(self) -> int:
        return len(self.paths)

    def read(self, indices: Sequence[int]) -> NDArray[np.uint8]:
        """Decode frames; see `contracts.Frames.read`."""
        check_range(indices, len(self), self.paths[0])
        out = np.empty((len(indices), *self.shape, 3), np.uint8)
        for place, i in enumerate(indices):
            read = partial(rgb_pixels, where=self.paths[i], white=self.white)
            frame = _image(self.paths[i], read, self.white)
            # files may be replaced between opening and reading: the array has one size
            if frame.shape[:2] != self.full_shape:
                raise DataError(
                    f"{self.paths[i]}: its size has changed to {size_text(frame.shape[:2])} pixels"
                )
            out[place] = self._show(frame)
        return out


class ArrayFrames:
    """Frames of an array in memory.

    Args:
        array: uint8 (T, H, W, 3), RGB.

    Raises:
        DataError: The array has another type or shape.

    Example:
        >>> film = ArrayFrames(np.zeros((4, 240, 320, 3), np.uint8))
        >>> len(film), film.shape, film.read([1, 3]).shape
        (4, (240, 320), (2, 240, 320, 3))
    """

    def __init__(self, array: NDArray[np.uint8]) -> None:
        if array.dtype != np.uint8 or array.ndim != 4 or array.shape[-1] != 3:
            fix = channel_fix(array.shape) if array.dtype == np.uint8 else value_fix(array)
            raise DataError(f"frames are uint8 (T, H, W, 3), not {array.dtype} {array.shape}{fix}")
        self.array = array

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width."""
        return int(self.array.shape[1]), int(self.array.shape[2])

    def __len__(self) -> int:
        return len(self.array)

    def read(self, indices: Sequence[int]) -> NDArray[np.uint8]:
        """Copy frames; see `contracts.Frames.read`."""
        check_range(indices, len(self), "array")
        return self.array[list(indices)]


def _head(path: str, white: float | None) -> ImageHeader:
    def read(image: Image.Image) -> ImageHeader:
        return ImageHeader(*upright_size(image), orientation(image) != 1)

    return _image(path, read, white)


def _image(path: str, read: Callable[[Image.Image], T], white: float | None) -> T:
    """Read an image file, by a function of the open image."""
    try:
        with open_picture(path) as image:
            check_depth(image, path, white)
            check_single(image, path)
            return read(image)
    except FileNotFoundError:
        raise DataNotFoundError(f"{path}: no such file; correct the path") from None
    except (OSError, SyntaxError, ValueError) as error:
        check_pointer(path)
        raise DataError(
            f"{path}: not a readable image ({error}); replace it, or remove it"
        ) from error
