"""Stacks of pictures in one file: the pages of a TIFF, or an array of NumPy."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from tactileforge.data.frames.crop import Crop, Cropped, check_range, size_text
from tactileforge.data.frames.picture_files import (
    check_depth,
    is_deep_grey,
    page_pixels,
    pages,
    upright_size,
)
from tactileforge.data.frames.pixel_contract import channel_fix, is_deep, pixels_of, value_fix
from tactileforge.data.frames.video import VideoFrames
from tactileforge.errors import DataError, DataNotFoundError
from tactileforge.util.regular import check_regular
from tactileforge.util.untrusted import MAX_PIXELS, open_picture

if TYPE_CHECKING:
    from PIL import Image

_TIFF = frozenset({".tif", ".tiff"})
#: Smallest side of a picture: an array with a last axis of colours is one picture, not a stack.
_SIDE = 16
#: Endings of files that may hold a stack.
STACK_SUFFIXES = _TIFF | {".npy"}


class StackFrames(Cropped):
    """Frames of a stack: pages of a TIFF, or an array of a .npy.

    The array is uint8 (T, H, W, 3) or (T, 3, H, W), RGB, or (T, H, W), grey. Opening reads headers
    only; a stack knows no times.

    Args:
        path: Path of the file.
        crop: Left, top, width, height in pixels; None shows everything.
        white: Value of white of grey pages, or of arrays, of 16 bits; None where there are none.

    Raises:
        DataNotFoundError: There is no such file.
        DataError: The file is damaged, its values are not pixels of 8 bits, or its pages differ in
            size.

    Example:
        >>> np.save("frames.npy", np.zeros((20, 48, 64, 3), np.uint8))
        >>> stack = StackFrames("frames.npy")
        >>> len(stack), stack.read([3]).shape
        (20, (1, 48, 64, 3))
    """

    def __init__(
        self, path: str | Path, crop: Crop | None = None, white: float | None = None
    ) -> None:
        self.path, self.white = str(path), white
        if Path(path).suffix.lower() in _TIFF:
            with _opened(self.path) as image:
                self._pages: Sequence[int] = pages(image)
                sizes = []
                for page in self._pages:
                    image.seek(page)
                    check_depth(image, f"{self.path}, page {page}", white)
                    sizes.append(upright_size(image))
            if odd := [page for page, size in enumerate(sizes) if size != sizes[0]]:
                raise DataError(
                    f"{self.path}: page {odd[0]} has {size_text(sizes[odd[0]])} pixels, the first "
                    f"{size_text(sizes[0])}: frames of one recording have one size"
                )
            size = sizes[0]
        else:
            array = self._array()
            size = int(array.shape[1]), int(array.shape[2])
            self._pages = range(len(array))
        super().__init__(self.path, size, crop)

    def __len__(self) -> int:
        return len(self._pages)

    def read(self, indices: Sequence[int]) -> NDArray[np.uint8]:
        """Decode frames; see `contracts.Frames.read`."""
        check_range(indices, len(self), self.path)
        out = np.empty((len(indices), *self.shape, 3), np.uint8)
        if Path(self.path).suffix.lower() not in _TIFF:
            array = self._array()
            for place, i in enumerate(indices):
                frame = pixels_of(array[i], self.white, self.path)
                out[place] = self._show(frame if frame.ndim == 3 else frame[..., None])
            return out
        with _opened(self.path) as image:
            # ascending: a page is found by walking from the one before
            for place in np.argsort(indices, kind="stable"):
                page = self._pages[int(indices[place])]
                image.seek(page)
                frame = page_pixels(image, f"{self.path}, page {page}", self.white)
                if frame.shape[:2] != self.full_shape:
                    raise DataError(f"{self.path}: has changed since it was opened; start again")
                out[place] = self._show(frame)
        return out

    def _array(self) -> NDArray[np.uint8]:
        """The array, mapped into memory."""
        array = load_array(self.path)
        if array.dtype != np.uint8 and not (self.white and is_deep(array.dtype)):
            fix = ", or give its layout the value of white" if is_deep(array.dtype) else ""
            raise DataError(f"{self.path}: {array.dtype} values{value_fix(array[:1])}{fix}")
        if array.ndim == 3 and array.shape[-1] in (1, 3, 4) and min(array.shape[:2]) >= _SIDE:
            raise DataError(
                f"{self.path}: one picture of {array.shape}, where a stack is (T, H, W, 3): save "
                "the pictures of a recording as one array (np.stack), or each as a PNG"
            )
        if array.ndim == 4 and array.shape[1] in (1, 3) and min(array.shape[2:]) >= _SIDE:
            array = np.moveaxis(array, 1, -1)  # channels first, as PyTorch has them
        colours = array.ndim == 4 and array.shape[-1] in (1, 3)
        if not (colours or array.ndim == 3) or 0 in array.shape:
            raise DataError(
                f"{self.path}: an array of {array.shape}, where frames are (T, H, W, 3) or "
                f"(T, H, W){channel_fix(array.shape)}"
            )
        if array.shape[1] * array.shape[2] > MAX_PIXELS:
            raise DataError(
                f"{self.path}: frames of {array.shape[1]} x {array.shape[2]} pixels, where "
                f"{MAX_PIXELS:,} in all are the limit"
            )
        return array


def load_array(path: str | Path) -> NDArray[Any]:
    """An array of a .npy file, mapped into memory; nothing in it is executed.

    Raises:
        DataNotFoundError: There is no such file.
        DataError: The file is damaged, cut off, or holds objects of Python.
    """
    try:
        check_regular(path)
        array: NDArray[Any] = np.load(path, mmap_mode="r", allow_pickle=False)
    except FileNotFoundError:
        raise DataNotFoundError(f"{path}: no such file; correct the path") from None
    except (OSError, ValueError, EOFError, SyntaxError, TypeError, OverflowError) as error:
        line = " ".join(str(error).split())
        if "Python objects" in line:
            raise DataError(
                f"{path}: objects of Python, which run code when they are read; of a dictionary of "
                f"arrays that you trust: python -c \"import numpy; numpy.savez('{Path(path).stem}"
                f".npz', **numpy.load('{Path(path).name}', allow_pickle=True).item())\""
            ) from error
        raise DataError(f"{path}: no readable array ({line}); save it with np.save") from error
    if not isinstance(array, np.ndarray):
        raise DataError(f"{path}: an archive of arrays, named .npy; rename it to .npz")
    return array


def deepest(path: Path) -> int:
    """Largest value of the first picture of a file of 16 bits; 0 for other files."""
    try:
        if path.suffix.lower() == ".npy":
            array = load_array(path)
            return int(array[:1].max()) if is_deep(array.dtype) and array.size else 0
        with _opened(str(path)) as image:
            return int(np.asarray(image).max()) if is_deep_grey(image) else 0
    except DataError:
        return 0  # named when it is read


def is_stack(path: Path) -> bool:
    """Whether a file is a stack: a TIFF of several pictures, or an array of NumPy."""
    if path.suffix.lower() == ".npy":
        return True
    if path.suffix.lower() not in _TIFF:
        return False
    try:
        with _opened(str(path)) as image:
            return len(pages(image)) > 1
    except DataError:
        return False  # named when it is read


def open_film(
    path: str | Path, stream: int = 0, white: float | None = None
) -> VideoFrames | StackFrames:
    """Open a video, or a stack by its ending.

    Args:
        path: The file.
        stream: Number of the stream of a video.
        white: Value of white of stacks of 16 bits; None where there are none.

    Raises:
        DataNotFoundError: There is no such file.
        DataError: It cannot be read; see `VideoFrames` and `StackFrames`.
    """
    is_stack = Path(path).suffix.lower() in STACK_SUFFIXES
    if is_stack:
        return StackFrames(path, white=white)
    return VideoFrames(path, stream=stream)


@contextmanager
def _opened(path: str) -> Iterator[Image.Image]:
    try:
        with open_picture(path) as image:
            yield image
    except FileNotFoundError:
        raise DataNotFoundError(f"{path}: no such file; correct the path") from None
    except (OSError, SyntaxError, ValueError, EOFError, TypeError, KeyError) as error:
        raise DataError(f"{path}: not a readable stack ({error}); replace or remove it") from error
