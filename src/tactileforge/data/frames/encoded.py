"""Frames stored as encoded images, or as arrays, inside another file."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from io import BytesIO
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactileforge.data.frames.crop import check_range, size_text
from tactileforge.data.frames.picture_files import rgb_pixels
from tactileforge.data.frames.pixel_contract import checked_pixels
from tactileforge.errors import DataError
from tactileforge.util.untrusted import open_picture

#: Errors of Pillow for damaged files: its plugins raise SyntaxError for headers, too.
_UNREADABLE = (OSError, SyntaxError, TypeError, ValueError)


@dataclass(frozen=True, slots=True)
class Blob:
    """A byte string in a file, read on demand.

    Attributes:
        path: Path of the file.
        offset: Position of its first byte.
        size: Number of bytes.

    Example:
        >>> from pathlib import Path
        >>> _ = Path("touch.bin").write_bytes(b"head" + b"picture")
        >>> Blob("touch.bin", offset=4, size=7).read()
        b'picture'
    """

    path: str
    offset: int
    size: int

    def read(self) -> bytes:
        """Read the bytes.

        Raises:
            DataError: The file has become shorter, or is gone.
        """
        try:
            with open(self.path, "rb") as file:
                file.seek(self.offset)
                content = file.read(self.size)
        except OSError as error:
            raise DataError(f"{self.path}: cannot be read: {error}") from error
        if len(content) != self.size:
            raise DataError(f"{self.path}: has become shorter; download it again")
        return content


class LazyImages(Sequence[Any]):
    """Images by number, read on demand, for `EncodedFrames`.

    Args:
        count: Number of images.
        read: Function from a number to the bytes of an image file, or to uint8 (H, W, 3);
            picklable where the frames are read by workers.
    """

    def __init__(self, count: int, read: Callable[[int], bytes | NDArray[np.uint8]]) -> None:
        self._numbers, self._read = range(count), read

    def __len__(self) -> int:
        return len(self._numbers)

    def __getitem__(self, i: Any) -> Any:
        numbers = self._numbers[i]
        return [self._read(n) for n in numbers] if isinstance(i, slice) else self._read(numbers)


class EncodedFrames:
    """Encoded images, decoded on demand.

    Args:
        name: Name of their source, for messages.
        images: Image of each frame: a `Blob` or bytes of an image file, or uint8 (H, W, 3).
        bgr: Whether the channels lie in the order blue, green, red.
        turns: Quarter turns, counter-clockwise, to put a frame upright.

    Raises:
        DataError: There is no frame.

    Example:
        >>> import numpy as np
        >>> from tactileforge.data import encode_image
        >>> picture = encode_image(np.zeros((240, 320, 3), np.uint8))
        >>> EncodedFrames("touch.parquet", [picture, picture], turns=1).read([1]).shape
        (1, 320, 240, 3)
    """

    def __init__(
        self,
        name: str,
        images: Sequence[Blob | bytes | NDArray[np.uint8]],
        bgr: bool = False,
        turns: int = 0,
    ) -> None:
        if not len(images):
            raise DataError(f"{name}: a recording without frames; download it again")
        self.name = name
        self.images = images
        self.bgr = bgr
        self.turns = turns

    def __len__(self) -> int:
        return len(self.images)

    @cached_property
    def shape(self) -> tuple[int, int]:
        """Height and width of the first frame, pixels."""
        height, width = self._frame(0).shape[:2]
        return int(height), int(width)

    def read(self, indices: Sequence[int]) -> NDArray[np.uint8]:
        """Decode frames; see `contracts.Frames.read`."""
        check_range(indices, len(self), self.name)
        out = np.empty((len(indices), *self.shape, 3), np.uint8)
        for place, i in enumerate(indices):
            frame = self._frame(i)
            if frame.shape != out.shape[1:]:
                raise DataError(
                    f"{self.name}, frame {i}: {size_text(frame.shape[:2])} pixels, where the first "
                    f"has {size_text(self.shape)}; download it again"
                )
            out[place] = frame
        return out

    def _frame(self, i: int) -> NDArray[np.uint8]:
        image = self.images[i]
        if isinstance(image, np.ndarray):
            frame = checked_pixels(image, f"{self.name}, frame {i}", 3)
        else:
            raw = image.read() if isinstance(image, Blob) else image
            try:
                with open_picture(BytesIO(raw)) as opened:
                    frame = rgb_pixels(opened, f"{self.name}, frame {i}")
            except _UNREADABLE as error:
                raise DataError(
                    f"{self.name}, frame {i}: not a readable image ({error}); download it again"
                ) from error
        # decoders give the order of the file; a writer that handed BGR to one of RGB exchanged it
        if self.bgr:
            frame = frame[..., ::-1]
        return np.rot90(frame, self.turns)
