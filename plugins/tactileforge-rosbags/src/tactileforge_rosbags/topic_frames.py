"""Pictures of a topic as frames: a clip reads its messages alone."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import lru_cache, partial
from io import BytesIO
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from tactileforge.data import EncodedFrames, LazyImages, upright_size
from tactileforge.errors import DataError
from tactileforge.plugins import open_picture
from tactileforge_rosbags.bags import Bag
from tactileforge_rosbags.map_keys import PictureKeys
from tactileforge_rosbags.series import Scan, Series, placed, scan

#: Types of messages of pictures.
COMPRESSED = "sensor_msgs/msg/CompressedImage"
KINDS = ("sensor_msgs/msg/Image", COMPRESSED)
#: Bytes a pixel of the raw encodings that are read.
_RAW = {"rgb8": 3, "bgr8": 3, "rgba8": 4, "bgra8": 4, "mono8": 1, "8UC1": 1}
#: Those of OpenCV, which do not say the order of channels.
_UNORDERED = {"8UC3": 3, "8UC4": 4}
#: Pairs of pixels with one colour, and what converts them.
_PAIRS = {
    **dict.fromkeys(("yuv422", "uyvy"), cv2.COLOR_YUV2RGB_UYVY),
    **dict.fromkeys(("yuv422_yuy2", "yuyv"), cv2.COLOR_YUV2RGB_YUY2),
}
_BYTES = _RAW | _UNORDERED | dict.fromkeys(_PAIRS, 2)
#: Last bytes of whole pictures, by the format's name in Pillow, and how near the end they lie.
_ENDS = {"JPEG": b"\xff\xd9", "PNG": b"IEND"}
_NEAR = 64
#: Messages between two wanted ones that are read rather than sought again.
_BETWEEN = 4


def image_of(message: Any) -> bytes | NDArray[np.uint8]:
    """Picture of a message: bytes of an image file, or uint8 RGB (H, W, 3).

    An alpha is left out: cameras fill it. 8UC3 and 8UC4 are taken for RGB; see `size_of`.

    Raises:
        DataError: Its encoding is not read, or it has too few bytes.
    """
    if hasattr(message, "format"):
        if "compressedDepth" in message.format:
            raise DataError(f"format {message.format!r} is a depth, and no picture; leave it out")
        return bytes(message.data)
    height, width, step = message.height, message.width, message.step
    encoding = message.encoding
    if encoding not in _BYTES:
        raise DataError(
            f"encoding {encoding!r}, where {', '.join(_BYTES)} are read; convert the topic"
        )
    row = width * _BYTES[encoding]
    if not height or not row or step < row or len(message.data) < height * step:
        raise DataError(
            f"{len(message.data)} bytes for {height} x {width} pixels in rows of {step} bytes"
        )
    rows = np.asarray(message.data)[: height * step].reshape(height, step)[:, :row]
    pixels = rows.reshape(height, width, -1)
    if encoding in _PAIRS:
        if width % 2:
            raise DataError(f"encoding {encoding!r} of {width} pixels a row: they come in pairs")
        converted: NDArray[np.uint8] = cv2.cvtColor(np.ascontiguousarray(pixels), _PAIRS[encoding])
        return converted
    if pixels.shape[2] == 1:
        return np.repeat(pixels, 3, axis=2)
    pixels = pixels[..., :3]
    return np.ascontiguousarray(pixels[..., ::-1] if encoding.startswith("bgr") else pixels)


def size_of(message: Any, is_ordered: bool = False) -> tuple[int, int]:
    """Height and width of the picture of a message, by its header.

    Args:
        message: The message.
        is_ordered: Whether the map says which of red and blue comes first.

    Raises:
        DataError: It is damaged, cut off, of an unknown format, or of one that needs that.
    """
    if not is_ordered and getattr(message, "encoding", "") in _UNORDERED:
        raise DataError(
            f"encoding {message.encoding!r} does not say the order of channels; say it in a map: "
            "channels: bgr where blue comes first (OpenCV, cv_bridge), or channels: rgb"
        )
    image = image_of(message)
    if isinstance(image, np.ndarray):
        return int(image.shape[0]), int(image.shape[1])
    try:
        with open_picture(BytesIO(image)) as opened:
            kind, size = str(opened.format), upright_size(opened)
    except (OSError, SyntaxError, TypeError, ValueError) as error:
        raise DataError(
            f"format {message.format!r}: no readable picture ({len(image)} bytes)"
        ) from error
    if kind in _ENDS and _ENDS[kind] not in image[-_NEAR:]:
        raise DataError(f"{kind} without its end ({len(image)} bytes)")
    return size


class BagFrames:
    """Pictures of a topic, read on demand.

    Args:
        series: Their messages.
        keys: How they lie.
        stored: Height and width, pixels, as they lie in the bag.
    """

    def __init__(self, series: Series, keys: PictureKeys, stored: tuple[int, int]) -> None:
        self.series, self.keys, self.stored = series, keys, stored

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width of the upright picture, pixels."""
        return self.stored[::-1] if self.keys.turns % 2 else self.stored

    def __len__(self) -> int:
        return len(self.series)

    def read(self, indices: Sequence[int]) -> NDArray[np.uint8]:
        """Reads pictures; see `contracts.Frames.read`."""
        if len(indices) and not 0 <= min(indices) <= max(indices) < len(self):
            raise DataError(f"{self.series}: frame {max(indices)} of {len(self)} is not there")
        images = dict(self._fetch(sorted({int(i) for i in indices})))
        clip = EncodedFrames(
            str(self.series),
            LazyImages(len(self), images.__getitem__),
        )
        clip.shape = self.stored
        return self.keys.upright(clip).read(indices)

    def _fetch(self, rows: list[int]) -> Iterator[tuple[int, bytes | NDArray[np.uint8]]]:
        """Yields pictures by number; rows near to each other are read in one go."""
        while rows:
            count = next(
                (i for i in range(1, len(rows)) if rows[i] - rows[i - 1] > _BETWEEN), len(rows)
            )
            run, rows = rows[:count], rows[count:]
            recorded, place = self.series.recorded, self.series.place
            wanted = {(int(recorded[i]), int(place[i])): i for i in run}
            first, last = int(recorded[run[0]]), int(recorded[run[-1]])
            for time, number, message in placed(
                self.series.bag, self.series.topic, first, last + 1
            ):
                if (i := wanted.pop((time, number), None)) is not None:
                    yield i, image_of(message)
            if wanted:
                raise DataError(f"{self.series}: has changed since it was opened; start again")


def open_frames(bag: Bag, keys: PictureKeys, changed: int) -> tuple[BagFrames, str]:
    """Frames of a topic, and a line on those left out, "" for none.

    Args:
        bag: The bag.
        keys: Its topic.
        changed: Time of the last change of the bag, for what is kept of an earlier reading.

    Raises:
        DataError: The topic is not there, of another type, empty, or none of its pictures is good.
    """
    found = _scan(bag, keys.topic, changed, keys.channels is not None)
    sizes = found.values
    height, width = sizes[0]
    same = np.array([size == sizes[0] for size in sizes])
    line = found.line
    if not same.all():
        other = sizes[int(np.argmin(same))]
        line += "; " if line else f"{found.series}: "
        line += f"{int((~same).sum())} pictures left out: of {other[0]} x {other[1]} pixels, where "
        line += f"the first has {height} x {width}"
    return BagFrames(found.series.take(same), keys, (height, width)), line


@lru_cache(maxsize=64)
def _scan(bag: Bag, topic: str, changed: int, is_ordered: bool) -> Scan:
    return scan(bag, topic, KINDS, partial(size_of, is_ordered=is_ordered))
