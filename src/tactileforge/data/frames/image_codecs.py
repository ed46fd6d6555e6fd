"""Image codecs of shards; images are read and verified in place."""

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
from tactileforge.data.frames.pixel_contract import checked_pixels
from tactileforge.errors import ConfigError, DataError, unknown
from tactileforge.untrusted import open_picture

#: Codecs by the ending of their files, and how OpenCV is told of them.
CODECS: dict[str, list[int]] = {
    "jpg": [cv2.IMWRITE_JPEG_QUALITY, 95],
    "png": [cv2.IMWRITE_PNG_COMPRESSION, 3],
    "webp": [cv2.IMWRITE_WEBP_QUALITY, 101],  # above 100: lossless
}

#: What the groups of images are called in a member's name, in the order they are written.
GROUPS = {"background": "background.", "image": "image.", "surface": "surface.", "frames": ""}
#: Codecs of groups that lossy compression would spoil; the others have the recording's.
_LOSSLESS = {"surface": "png"}
_PNG = b"\x89PNG"
#: Bytes of a block of a tar file: a member is one with its name, and its content in whole ones.
BLOCK = 512


def encode_image(image: NDArray[np.uint8], codec: str = "jpg", quality: int | None = None) -> bytes:
    """Encodes an image, uint8 (H, W, 3), RGB.

    Args:
        image: The image.
        codec: ``jpg``, or without loss ``png`` or ``webp``.
        quality: Of JPEG, 1 to 100; 95 if not given.

    Raises:
        ConfigError: An unknown codec, or a quality that is none.
        DataError: The image is of another type or shape.
    """
    checked_pixels(image, "an image to store", 3)
    if codec not in CODECS:
        raise ConfigError(unknown("codec", codec, CODECS))
    options = CODECS[codec]
    if quality is not None:
        if codec != "jpg" or not 1 <= quality <= 100:
            raise ConfigError(f"quality={quality}: only jpg has one, from 1 to 100")
        options = [cv2.IMWRITE_JPEG_QUALITY, quality]
    done, out = cv2.imencode(f".{codec}", cv2.cvtColor(image, cv2.COLOR_RGB2BGR), options)
    if not done:
        raise DataError(f"an image of {image.shape} could not be encoded as {codec}")
    return out.tobytes()


def member_name(group: str, number: int, codec: str) -> str:
    """Name of an image's member, after the number of its recording."""
    return f"{GROUPS[group]}{number:04d}.{codec_of(group, codec)}"


def codec_of(group: str, codec: str) -> str:
    """The codec of a group in a recording of some codec."""
    return _LOSSLESS.get(group, codec)


def image_size(data: bytes) -> tuple[int, int]:
    """Reads height and width from the header alone."""
    if data[:2] == b"\xff\xd8":  # JPEG: go from segment to segment to the start of frame
        place = 2
        while len(segment := data[place : place + 9]) == 9:
            if 0xC0 <= segment[1] <= 0xCF and segment[1] not in (0xC4, 0xC8, 0xCC):
                return int.from_bytes(segment[5:7]), int.from_bytes(segment[7:9])
            place += 2 + int.from_bytes(segment[2:4])
    with open_picture(io.BytesIO(data)) as opened:
        return opened.height, opened.width


class PackedFrames:
    """Images of a shard, read and verified in place.

    Args:
        name: Of the recording, for messages.
        path: The shard.
        stem: What the members' names begin with.
        group: A key of `GROUPS`.
        codec: One of `CODECS`, of the recording.
        shape: Height and width.
        starts: int64 (n,), where the header of each member begins.
        sizes: int64 (n,), bytes of each image.
        crcs: uint32 (n,), CRC-32 of each.
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
        """The bytes of one image.

        Raises:
            DataError: They are not where the JSON says, or are damaged.
        """
        try:
            with self.path.open("rb") as file:
                return self._checked(file, i)
        except OSError as error:
            raise DataError(f"{self.path}: cannot be read ({error})") from error

    def read(self, indices: Sequence[int]) -> NDArray[np.uint8]:
        """Decodes; see `contracts.Frames.read`."""
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
        block = file.read(BLOCK + size)
        member = f"{self.stem}.{member_name(self.group, i, self.codec)}"
        if block[:100].rstrip(b"\0") != member.encode():
            raise DataError(f"{self.path}: {member} of {self.name} is not there; pack it again")
        picture = block[BLOCK:]
        if len(picture) != size or zlib.crc32(picture) != int(self.crcs[i]):
            raise DataError(
                f"{self.path}: {member} of {self.name} is damaged; download or pack it again"
            )
        return picture

    def _decoded(self, data: bytes, i: int) -> NDArray[np.uint8]:
        shape = self.shape
        try:
            shape = image_size(data)  # before anything of that size is allocated
        except (OSError, ValueError, SyntaxError) as error:
            raise DataError(f"{self.name}, {self.group} {i}: not an image ({error})") from error
        if shape != self.shape:
            raise DataError(
                f"{self.name}, {self.group} {i}: {size_text(shape)} pixels, where "
                f"{size_text(self.shape)} are stated; pack it again"
            )
        if data.startswith(_PNG) and data[24] > 8:  # else cut to the upper byte
            raise DataError(
                f"{self.name}, {self.group} {i}: {data[24]} bits a channel; pack 8 bits a channel"
            )
        frame = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR_RGB)
        if frame is None:
            raise DataError(f"{self.name}, {self.group} {i}: cannot be decoded; pack it again")
        out: NDArray[np.uint8] = frame
        return out
