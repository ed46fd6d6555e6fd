"""Picture files of 8 bits a channel as RGB; what cannot be shown so without loss is refused."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from tactileforge.errors import DataError

if TYPE_CHECKING:
    from PIL import Image

#: Modes of Pillow with an alpha.
_ALPHA = frozenset({"LA", "La", "PA", "RGBA", "RGBa"})
#: Modes whose colours depend on the ink, or on a white point.
_PRINT = frozenset({"CMYK", "LAB"})


def check_depth(image: Image.Image, where: str) -> None:
    """Raises an error where a picture has more than 8 bits a channel, or colours of a printer.

    Args:
        image: Open, not decoded: only its header is read.
        where: What it is, for messages.

    Raises:
        DataError: It is such a picture; says which.
    """
    if image.mode[0] in "IF":
        raise DataError(f"{where}: {image.mode} pixels; convert it to 8 bits a channel")
    if _is_deep(image):
        raise DataError(
            f"{where}: 16 bits a channel ({image.mode}); convert it to 8 bits a channel"
        )
    if image.mode in _PRINT:
        raise DataError(f"{where}: {image.mode} pixels; convert it to RGB, 8 bits a channel")


def rgb_pixels(image: Image.Image, where: str) -> NDArray[np.uint8]:
    """The pixels of a picture, uint8 (H, W, 3).

    Args:
        image: Open.
        where: See `check_depth`.

    Raises:
        DataError: See `check_depth`; or a pixel is transparent, and so has no colour.
        OSError: It cannot be decoded.
    """
    check_depth(image, where)
    if image.mode in _ALPHA or "transparency" in image.info:
        pixels = np.asarray(image.convert("RGBA"))
        if pixels[..., 3].min() < 255:
            share = float((pixels[..., 3] < 255).mean())
            raise DataError(
                f"{where}: {share:.0%} of its pixels are transparent, so they have no colour of "
                "their own; save it without an alpha"
            )
        return np.ascontiguousarray(pixels[..., :3])
    return np.asarray(image.convert("RGB"))


def _is_deep(image: Image.Image) -> bool:
    """Whether Pillow would cut 16 bits to the upper 8; it names them in how it decodes alone."""
    if any(bits > 8 for bits in _tiff_bits(image)):
        return True
    for tile in getattr(image, "tile", ()):
        args = tile[3] if isinstance(tile[3], tuple) else (tile[3],)
        if any(isinstance(arg, str) and ";16" in arg and arg[:2] != "BG" for arg in args):
            return True
        if tile[0].startswith("ppm") and any(isinstance(arg, int) and arg > 255 for arg in args):
            return True
    return False


def _tiff_bits(image: Image.Image) -> tuple[int, ...]:
    tags = getattr(image, "tag_v2", None)
    bits = tags.get(258, ()) if tags is not None else ()
    return bits if isinstance(bits, tuple) else (int(bits),)
