"""Image codecs of shards, and lazy images verified in place."""

from __future__ import annotations

import io
import zlib
from collections.abc import Sequence
from pathlib import Path
from typing import BinaryIO

import cv2
import numpy as np
from numpy.typing import NDArray

from tactileforge.data.frames.crop import check_range, size_text
from tactileforge.data.frames.picture_files import orientation
from tactileforge.data.frames.pixel_contract import checked_pixels
from tactileforge.errors import ConfigError, DataError, unknown
from tactileforge.util.pointers import pointer_words
from tactileforge.util.untrusted import open_picture

#: Codecs by the ending of their files, with OpenCV's options. JPEG 95 is OpenCV's default; PNG 3
#: keeps compression fast.
CODECS: dict[str, list[int]] = {
    "jpg": [cv2.IMWRITE_JPEG_QUALITY, 95],
    "png": [cv2.IMWRITE_PNG_COMPRESSION, 3],
    "webp": [cv2.IMWRITE_WEBP_QUALITY, 101],  # above 100: lossless
}

#: Groups of images and their part of a member's name, in the order of writing.
GROUPS = {"background": "background.", "image": "image.", "surface": "surface.", "frames": ""}
#: Codecs of groups without tolerance for loss (coded displacements); the others have the
#: recording's.
_LOSSLESS = {"surface": "png"}
#: OpenCV turns some formats by their EXIF orientation; `check_upright` has seen to that.
_AS_STORED = cv2.IMREAD_COLOR_RGB | cv2.IMREAD_IGNORE_ORIENTATION
_PNG = b"\x89PNG"
#: Bytes of a block of a tar file (POSIX ustar): a member is a header block and whole blocks of
#: content.
TAR_BLOCK = 512


def encode_image(image: NDArray[np.uint8], codec: str = "jpg", quality: int | None = None) -> bytes:
    r"""Encode an image.

    Args:
        image: uint8 (H, W, 3), RGB.
        codec: ``jpg``, or without loss ``png`` or ``webp``.
        quality: JPEG quality, 1 to 100; None for 95.

    Raises:
        ConfigError: Unknown codec or invalid quality.
        DataError: The image is of another type or shape.

    Example:
        >>> encode_image(np.zeros((2, 2, 3), np.uint8), "png")[:4]
        b'\x89PNG'
    """
    checked_pixels(image, "an image to store", 3)
    if codec not in CODECS:
        raise ConfigError(unknown("codec", codec, CODECS))
    options = CODECS[codec]
    if quality is not None:
        if codec != "jpg" or not 1 <= quality <= 100:
            raise ConfigError(f"quality={quality}: only jpg has one, from 1 to 100")
        options = [cv2.IMWRITE_JPEG_QUALITY, quality]
    # OpenCV takes what it is given for BGR
    done, out = cv2.imencode(f".{codec}", cv2.cvtColor(image, cv2.COLOR_RGB2BGR), options)
    if not done:
        raise DataError(f"an image of {image.shape} could not be encoded as {codec}")
    return out.tobytes()


def member_name(group: str, number: int, codec: str) -> str:
    """Name of the member of an image, without the number of its recording."""
    return f"{GROUPS[group]}{number:04d}.{codec_of(group, codec)}"


def codec_of(group: str, codec: str) -> str:
    """Codec of a group of images, given the codec of the recording."""
    return _LOSSLESS.get(group, codec)


def image_size(data: bytes) -> tuple[int, int]:
    """Read height and width from the header alone."""
    # JPEG by hand, as it is read for every image of a shard: from segment to segment to the start
    # of frame (SOF, ITU-T T.81, table B.1; C4, C8 and CC in that range are not frames)
    if data[:2] == b"\xff\xd8":
        place = 2
        while len(segment := data[place : place + 9]) == 9:
            if 0xC0 <= segment[1] <= 0xCF and segment[1] not in (0xC4, 0xC8, 0xCC):
                return int.from_bytes(segment[5:7]), int.from_bytes(segment[7:9])
            place += 2 + int.from_bytes(segment[2:4])
    with open_picture(io.BytesIO(data)) as opened:
        return opened.height, opened.width


def check_upright(data: bytes, where: str) -> None:
    """Raises a `DataError` for an image with an EXIF orientation: decoders differ in heeding it."""
    if b"Exif" not in data and b"eXIf" not in data and b"EXIF" not in data:
        return
    with open_picture(io.BytesIO(data)) as opened:
        turned = orientation(opened)
    if turned != 1:
        raise DataError(f"{where}: has the EXIF orientation {turned}; encode its upright pixels")


class PackedFrames:
    """Images of a shard, read and verified in place.

    Args:
        name: Name of the recording, for messages.
        path: Path of the shard.
        stem: Start of the names of members.
        group: Group of images, a key of `GROUPS`.
        codec: Codec of the recording, one of `CODECS`.
        shape: Height and width, pixels.
        starts: int64 (n,), byte positions of the headers of members.
        sizes: int64 (n,), bytes of each image.
        crcs: uint32 (n,), CRC-32 of each image.
    """

    def __init__(
        self,
        name: str,
        path: Path,
        stem: str,
        group: str,
        codec: str,
        shape: tuple[int, int],
        starts: NDArray[np.int64],
        sizes: NDArray[np.int64],
        crcs: NDArray[np.uint32],
    ) -> None:
        if codec not in CODECS:
            raise DataError(f"{name}: {unknown('codec', str(codec), CODECS)}")
        self.name = name
        self.path = path
        self.stem = stem
        self.group = group
        self.codec = codec_of(group, codec)
        self.shape = shape
        self.starts, self.sizes, self.crcs = starts, sizes, crcs

    def __len__(self) -> int:
        return len(self.sizes)

    def encoded(self, i: int) -> bytes:
        """Read the bytes of one image.

        Raises:
            DataError: The image is damaged, or not at the place stated by the JSON.
        """
        try:
            with self.path.open("rb") as file:
                return self._checked(file, i)
        except OSError as error:
            raise DataError(f"{self.path}: cannot be read ({error})") from error

    def read(self, indices: Sequence[int]) -> NDArray[np.uint8]:
        """Decode frames; see `contracts.Frames.read`."""
        check_range(indices, len(self), self.name)
        out = np.empty((len(indices), *self.shape, 3), np.uint8)
        try:
            with self.path.open("rb") as file:
                for place, i in enumerate(indices):
                    out[place] = self._decoded(self._checked(file, i), i)
        except OSError as error:
            raise DataError(f"{self.path}: cannot be read ({error})") from error
        return out

    def _checked(self, file: BinaryIO, i: int) -> bytes:
        size = int(self.sizes[i])
        file.seek(int(self.starts[i]))
        # the header too: it proves that the picture is the one that the JSON names
        block = file.read(TAR_BLOCK + size)
        member = f"{self.stem}.{member_name(self.group, i, self.codec)}"
        if block[:100].rstrip(b"\0") != member.encode():
            raise DataError(f"{self.path}: {member} of {self.name} is not there; pack it again")
        picture = block[TAR_BLOCK:]
        if len(picture) != size or zlib.crc32(picture) != int(self.crcs[i]):
            raise DataError(
                f"{self.path}: {member} of {self.name} is damaged; download or pack it again"
            )
        return picture

    def _decoded(self, data: bytes, i: int) -> NDArray[np.uint8]:
        shape = self.shape
        try:
            shape = image_size(data)  # checked before OpenCV allocates anything of that size
        except (OSError, ValueError, SyntaxError) as error:
            words = pointer_words(data) or f"not an image ({error})"
            raise DataError(f"{self.name}, {self.group} {i}: {words}") from error
        if shape != self.shape:
            raise DataError(
                f"{self.name}, {self.group} {i}: {size_text(shape)} pixels, where "
                f"{size_text(self.shape)} are stated; pack it again"
            )
        # byte 24 is the bit depth of a PNG (its specification, IHDR); OpenCV would silently keep
        # the upper byte of 16 bits
        if data.startswith(_PNG) and data[24] > 8:
            raise DataError(
                f"{self.name}, {self.group} {i}: {data[24]} bits a channel; pack 8 bits a channel"
            )
        frame = cv2.imdecode(np.frombuffer(data, np.uint8), _AS_STORED)
        if frame is None:
            raise DataError(f"{self.name}, {self.group} {i}: cannot be decoded; pack it again")
        out: NDArray[np.uint8] = frame
        return out
