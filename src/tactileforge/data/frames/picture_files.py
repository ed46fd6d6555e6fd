"""Picture files as RGB of 8 bits a channel; lossy conversions are refused."""

from __future__ import annotations

import struct
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from tactileforge.data.frames.pixel_contract import pixels_of
from tactileforge.errors import DataError

if TYPE_CHECKING:
    from PIL import Image

#: Endings of files of pictures.
IMAGE_SUFFIXES = frozenset({".bmp", ".jpeg", ".jpg", ".png", ".tif", ".tiff", ".webp"})
#: Modes of Pillow with an alpha channel.
_ALPHA = frozenset({"LA", "La", "PA", "RGBA", "RGBa"})
#: Tag of the orientation (Exif 2.32, section 4.6.4), and what puts rows and columns upright.
_TAG = 0x0112
_UPRIGHT: dict[int, Callable[[NDArray[np.uint8]], NDArray[np.uint8]]] = {
    2: lambda a: a[:, ::-1],
    3: lambda a: a[::-1, ::-1],
    4: lambda a: a[::-1],
    5: lambda a: a.swapaxes(0, 1),
    6: lambda a: np.rot90(a, -1),
    7: lambda a: a[::-1, ::-1].swapaxes(0, 1),
    8: lambda a: np.rot90(a),
}
#: Modes without a fixed RGB: colours depend on the ink, or on a white point.
_PRINT = frozenset({"CMYK", "LAB"})


#: Command that copies a folder, with pictures of 8 bits for those of 16.
_EIGHT_BITS = (
    "in the folder of the data, as a copy of it beside, 8bit: "
    'python -c "import cv2, pathlib, shutil; '
    "[cv2.imwrite(str(p), (i * (255 / 65535)).round().astype('u1')) "
    "for p in pathlib.Path(shutil.copytree('.', '../8bit')).rglob('*') "
    "if p.suffix.lower() in ('.png', '.tif', '.tiff', '.ppm') "
    "and (i := cv2.imread(str(p), -1)).dtype == 'u2']\""
)


def is_deep_grey(image: Image.Image) -> bool:
    """Whether an open picture is grey, of 16 bits."""
    # before its version 11, Pillow opened PNG of them with more bits
    return image.mode.startswith("I;16") or (image.mode == "I" and image.format == "PNG")


def check_depth(image: Image.Image, where: str, white: float | None = None) -> None:
    """Check a picture for at most 8 bits a channel and colours of a screen.

    Args:
        image: Open image; only its header is read.
        where: Name of the picture, for messages.
        white: Value of white of grey pictures of 16 bits; None where these are not read.

    Raises:
        DataError: More bits, or colours of a printer.
    """
    if image.mode[0] in "IF":
        if is_deep_grey(image) and white is not None:
            return
        if is_deep_grey(image):
            raise DataError(
                f"{where}: {image.mode} pixels, 16 bits; convert it to 8 bits a channel, or give "
                "the layout of its folder the value of white: 1023, 4095, 16383 or 65535 (10, 12, "
                "14 or 16 bits)"
            )
        raise DataError(f"{where}: {image.mode} pixels; convert it to 8 bits a channel")
    if _is_deep(image):
        raise DataError(
            f"{where}: 16 bits a channel ({image.mode}); convert it to 8 bits a channel, with the "
            f"camera's white for 65535, {_EIGHT_BITS}"
        )
    if image.mode in _PRINT:
        raise DataError(f"{where}: {image.mode} pixels; convert it to RGB, 8 bits a channel")


def orientation(image: Image.Image) -> int:
    """Orientation of an open picture by its EXIF tag, 1 to 8; 1 without a tag, for upright.

    Only the header is read: a PNG may have its EXIF behind the pixels, and counts as without then.
    Pillow turns TIFF by itself.
    """
    if image.format == "TIFF" or (image.format == "PNG" and "exif" not in image.info):
        return 1
    try:
        found = image.getexif().get(_TAG, 1)
    except (OSError, SyntaxError, TypeError, ValueError, struct.error):
        return 1  # a damaged EXIF says nothing
    return found if found in _UPRIGHT else 1


def upright_size(image: Image.Image) -> tuple[int, int]:
    """Height and width of an open picture, pixels, as `rgb_pixels` gives it."""
    sideways = orientation(image) >= 5
    return (image.width, image.height) if sideways else (image.height, image.width)


def pages(image: Image.Image) -> list[int]:
    """Numbers of the pictures of a file; small copies of a TIFF's picture do not count.

    A photograph with a second view behind it (MPO) is one picture.
    """
    count: int = getattr(image, "n_frames", 1)
    if image.format == "MPO" or count == 1:
        return [0]
    if image.format != "TIFF":
        return list(range(count))
    out = []
    for page in range(count):
        image.seek(page)
        # 254 is NewSubfileType (TIFF 6.0, section 8): bit 0 for a reduced copy, bit 2 for a mask
        if not int(image.tag_v2.get(254, 0)) & 5:  # type: ignore[attr-defined]
            out.append(page)
    image.seek(0)
    return out or [0]


def check_single(image: Image.Image, where: str) -> None:
    """Raises a `DataError` for a file of several pictures."""
    if (count := len(pages(image))) > 1:
        fix = "give videos: and its pattern" if image.format == "TIFF" else "save each by itself"
        raise DataError(f"{where}: {count} pictures in one file; {fix}")


def rgb_pixels(image: Image.Image, where: str, white: float | None = None) -> NDArray[np.uint8]:
    """Decode a picture to uint8 (H, W, 3), upright by its EXIF orientation.

    Args:
        image: Open image.
        where: Name of the picture, for messages.
        white: Value of white of grey pictures of 16 bits; None where these are not read.

    Raises:
        DataError: An error of `check_depth` or `check_single`, or a transparent pixel, as it has
            no colour.
        OSError: It cannot be decoded.
    """
    check_single(image, where)
    return page_pixels(image, where, white)


def page_pixels(image: Image.Image, where: str, white: float | None = None) -> NDArray[np.uint8]:
    """Decode the current page of a file of pictures; see `rgb_pixels`."""
    check_depth(image, where, white)
    # before the pixels, which may be followed by a tag that no other door reads
    turned = orientation(image)
    if image.mode in _ALPHA or "transparency" in image.info:
        # RGBA also for a palette: convert("RGB") would drop its transparent colour unseen
        pixels = np.asarray(image.convert("RGBA"))
        if pixels[..., 3].min() < 255:
            share = float((pixels[..., 3] < 255).mean())
            raise DataError(
                f"{where}: {share:.0%} of its pixels are transparent, so they have no colour of "
                "their own; save it without an alpha"
            )
        pixels = np.ascontiguousarray(pixels[..., :3])
    elif white is not None and is_deep_grey(image):
        pixels = np.repeat(pixels_of(np.asarray(image), white, where)[..., None], 3, axis=2)
    else:
        pixels = np.asarray(image.convert("RGB"))
    return np.ascontiguousarray(_UPRIGHT[turned](pixels)) if turned in _UPRIGHT else pixels


def _is_deep(image: Image.Image) -> bool:
    """Whether Pillow would cut 16 bits a channel to the upper 8.

    Pillow has no mode for RGB of 16 bits (python-pillow/Pillow#1888) and opens such files as RGB:
    only the arguments of its decoders tell. This can go once it has one.
    """
    # 258 is BitsPerSample (TIFF 6.0, section 8): a number, or one for each channel
    bits = (getattr(image, "tag_v2", None) or {}).get(258, ())
    if any(one > 8 for one in (bits if isinstance(bits, tuple) else (int(bits),))):
        return True
    for tile in getattr(image, "tile", ()):
        args = tile[3] if isinstance(tile[3], tuple) else (tile[3],)
        if any(isinstance(arg, str) and ";16" in arg and arg[:2] != "BG" for arg in args):
            return True
        if tile[0].startswith("ppm") and any(isinstance(arg, int) and arg > 255 for arg in args):
            return True
    return False
