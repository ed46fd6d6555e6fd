"""Shards: plain tar files of recordings, that any tool can read (`docs/shards.md`).

A recording is ``KEY.json`` (all but the pictures), ``KEY.background.0000.jpg`` and on,
``KEY.image.0000.jpg`` and on, and ``KEY.0000.jpg`` and on. The JSON says how large each picture is
and its checksum, so a shard is opened by reading its JSON alone, and pictures are read, and
checked, where they lie.
"""

from __future__ import annotations

import io
import json
import math
import os
import re
import tarfile
import zlib
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from tactileforge.contracts import Recording
from tactileforge.data.cropped import as_text, check_range
from tactileforge.errors import ConfigError, DataError, unknown

#: Version of the layout; a reader refuses another.
VERSION = 2

#: Codecs by the ending of their files, and how OpenCV is told of them.
CODECS: dict[str, list[int]] = {
    "jpg": [cv2.IMWRITE_JPEG_QUALITY, 95],
    "png": [cv2.IMWRITE_PNG_COMPRESSION, 3],
    "webp": [cv2.IMWRITE_WEBP_QUALITY, 101],  # above 100: lossless
}

#: What the groups of pictures are called in a member's name, in the order they are written.
_GROUPS = {"background": "background.", "image": "image.", "frames": ""}
_BLOCK = 512
_JSON = re.compile(r"\d{6,}\.json")
#: A JSON of more bytes, and a picture of more pixels, are none of ours.
_MAX_JSON = 1 << 28
_MAX_PIXELS = 1 << 26


@dataclass(frozen=True)
class Packed:
    """A recording whose pictures are encoded.

    Attributes:
        head: All else, as plain data.
        codec: One of `CODECS`.
        frames: Encoded frames.
        background: Encoded frames without contact; [] where there are none.
        image: Encoded camera views; [] where there are none.
    """

    head: dict[str, Any]
    codec: str
    frames: Sequence[bytes]
    background: Sequence[bytes]
    image: Sequence[bytes]


def encode(picture: NDArray[np.uint8], codec: str = "jpg", quality: int | None = None) -> bytes:
    """Encodes a picture, uint8 (H, W, 3), RGB.

    Args:
        picture: The picture.
        codec: ``jpg``, or without loss ``png`` or ``webp``.
        quality: Of JPEG, 1 to 100; 95 if not given.

    Raises:
        ConfigError: An unknown codec, or a quality that is none.
    """
    if codec not in CODECS:
        raise ConfigError(unknown("codec", codec, CODECS))
    options = CODECS[codec]
    if quality is not None:
        if codec != "jpg" or not 1 <= quality <= 100:
            raise ConfigError(f"quality={quality}: only jpg has one, from 1 to 100")
        options = [cv2.IMWRITE_JPEG_QUALITY, quality]
    done, out = cv2.imencode(f".{codec}", cv2.cvtColor(picture, cv2.COLOR_RGB2BGR), options)
    if not done:
        raise DataError(f"a picture of {picture.shape} could not be encoded as {codec}")
    return out.tobytes()


def head(recording: Recording) -> dict[str, Any]:
    """All of a recording but its pictures, as plain data."""
    force = None
    if recording.force is not None:
        rows = recording.force.astype(float).tolist()
        force = [None if any(map(math.isnan, row)) else row for row in rows]
    seen = recording.image_times
    return {
        "version": VERSION,
        "key": recording.key,
        "sensor": recording.sensor,
        "times": recording.times.tolist(),
        "force": force,
        "action": None if recording.action is None else recording.action.tolist(),
        "object": recording.object,
        "text": recording.text,
        "image_times": None if seen is None else seen.tolist(),
        "labels": dict(recording.labels),
        "tracks": {
            name: {"dtype": values.dtype.name, "values": values.tolist()}
            for name, values in recording.tracks.items()
        },
        "source": recording.source,
        "tier": recording.tier,
        "licence": recording.licence,
    }


def write(path: Path, recordings: Iterable[Packed]) -> None:
    """Writes a shard: beside its place, then renamed. The same content gives the same bytes."""
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_name(f"{path.name}.{os.getpid()}.part")
    try:
        with tarfile.open(part, "w", format=tarfile.USTAR_FORMAT) as tar:
            for number, packed in enumerate(recordings):
                _add(tar, f"{number:06d}", packed)
        part.replace(path)
    finally:
        part.unlink(missing_ok=True)


def _add(tar: tarfile.TarFile, stem: str, packed: Packed) -> None:
    def member(name: str, content: bytes) -> None:
        info = tarfile.TarInfo(f"{stem}.{name}")
        info.size = len(content)
        tar.addfile(info, io.BytesIO(content))

    pictures = {group: getattr(packed, group) for group in _GROUPS if getattr(packed, group)}
    about = packed.head | {
        "codec": packed.codec,
        "pictures": {
            group: {
                "shape": _shape(encoded[0]),
                "bytes": [len(picture) for picture in encoded],
                "crc32": [zlib.crc32(picture) for picture in encoded],
            }
            for group, encoded in pictures.items()
        },
    }
    member("json", json.dumps(about | {"crc32": _checksum(about)}).encode())
    for group, encoded in pictures.items():
        for number, picture in enumerate(encoded):
            member(_name(group, number, packed.codec), picture)


def _name(group: str, number: int, codec: str) -> str:
    return f"{_GROUPS[group]}{number:04d}.{codec}"


def _shape(picture: bytes) -> tuple[int, int]:
    """Height and width, from the header alone."""
    if picture[:2] == b"\xff\xd8":  # JPEG: go from segment to segment to the start of frame
        place = 2
        while len(segment := picture[place : place + 9]) == 9:
            if 0xC0 <= segment[1] <= 0xCF and segment[1] not in (0xC4, 0xC8, 0xCC):
                return int.from_bytes(segment[5:7]), int.from_bytes(segment[7:9])
            place += 2 + int.from_bytes(segment[2:4])
    with Image.open(io.BytesIO(picture)) as opened:
        return opened.height, opened.width


def _checksum(about: dict[str, Any]) -> int:
    return zlib.crc32(json.dumps(about, sort_keys=True).encode())


def _raise(error: DataError) -> None:
    raise error


def read(path: Path, bad: Callable[[DataError], None] = _raise) -> Iterator[Recording]:
    """The recordings of a shard; no picture is read.

    Args:
        path: The file.
        bad: Is told of each recording that is damaged, and of a file that is cut off; the others
            are yielded all the same. Raises unless something else is given.

    Raises:
        DataError: The file is no shard, or is of another version; names it.
    """
    try:
        with path.open("rb") as file:
            yield from _scan(file, path, bad)
    except OSError as error:
        raise DataError(f"{path}: cannot be read ({error}); download or pack it again") from error


def _scan(file: BinaryIO, path: Path, bad: Callable[[DataError], None]) -> Iterator[Recording]:
    size = os.fstat(file.fileno()).st_size
    place = pictures = 0
    while True:
        try:
            member = _member(file, path, place)
        except DataError:
            if place == pictures:
                raise
            place = pictures  # the pictures are not what was stated: go from member to member
            continue
        if member is None:
            break
        name, length = member
        start, place = place + _BLOCK, place + _BLOCK + _padded(length)
        pictures = place
        if not _JSON.fullmatch(name):  # after a damaged description, its pictures follow
            if ".." in name or name.startswith("/"):
                bad(DataError(f"{path}: a member is called {name!r}; this is no shard of ours"))
            continue
        if length > _MAX_JSON:
            bad(DataError(f"{path}:{name}: a description of {length} bytes; pack it again"))
            continue
        if place > size:
            break
        try:
            about = _head(file.read(length), f"{path}:{name}")
            recording, place = _recording(path, name.removesuffix(".json"), about, start + length)
        except DataError as error:
            bad(error)
            continue
        if place > size:
            break
        yield recording
    if place + _BLOCK > size:  # a whole tar ends with blocks of zeros
        bad(DataError(f"{path}: cut off at byte {size}; download or pack it again"))


def _member(file: BinaryIO, path: Path, place: int) -> tuple[str, int] | None:
    """Name and size of the member at a place; None at the end."""
    file.seek(place)
    block = file.read(_BLOCK)
    if len(block) < _BLOCK or not block.strip(b"\0"):
        return None
    try:
        info = tarfile.TarInfo.frombuf(block, "utf-8", "surrogateescape")
    except tarfile.HeaderError as error:
        raise DataError(f"{path}: no tar at byte {place} ({error}); pack it again") from error
    return info.name, info.size


def _padded(size: int) -> int:
    return -(-size // _BLOCK) * _BLOCK


def _head(text: bytes, where: str) -> dict[str, Any]:
    try:
        about = json.loads(text)
        stated = about.pop("crc32")
        version = about["version"]
    except (ValueError, TypeError, AttributeError, KeyError) as error:
        raise DataError(f"{where}: no description of a recording ({error!r})") from error
    if version != VERSION:
        raise DataError(
            f"{where}: shard version {version}, but this tactileforge reads {VERSION}; pack the "
            "data again"
        )
    if stated != _checksum(about):
        raise DataError(f"{where}: damaged (its checksum is another); download or pack it again")
    found: dict[str, Any] = about
    return found


def _recording(path: Path, stem: str, about: Any, place: int) -> tuple[Recording, int]:
    """A recording whose JSON ends at a place, and where the next one begins."""
    where = f"{path}:{about.get('key', stem)}"
    place = _padded(place)
    try:
        lazy = {}
        for group in _GROUPS:
            if group not in about["pictures"]:
                continue
            table = about["pictures"][group]
            sizes = np.array(table["bytes"], np.int64)
            crcs = np.array(table["crc32"], np.uint32)
            if not len(sizes) or sizes.shape != crcs.shape or sizes.min() < 0:
                raise ValueError(f"{group}: {len(sizes)} sizes, {len(crcs)} checksums")
            ends = place + np.cumsum(_BLOCK + -(-sizes // _BLOCK) * _BLOCK)
            starts = np.concatenate([[place], ends[:-1]])
            place = int(ends[-1])
            height, width = map(int, table["shape"])
            if not 0 < height * width <= _MAX_PIXELS:
                raise ValueError(f"{group}: {height} x {width} pixels")
            lazy[group] = PackedFrames(
                where, path, stem, group, about["codec"], (height, width), starts, sizes, crcs
            )
        return _build(about, lazy), place
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise DataError(f"{where}: its description is wrong ({error!r}); pack it again") from error


def _build(about: dict[str, Any], lazy: dict[str, PackedFrames]) -> Recording:
    times = np.array(about["times"], np.float64)
    force, action, seen = about["force"], about["action"], about["image_times"]
    tracks = {name: _track(track) for name, track in about["tracks"].items()}
    columns = {"times": times, "force": force, "action": action, **tracks}
    for name, column in columns.items():
        if column is not None and len(column) != len(lazy["frames"]):
            raise ValueError(f"{len(lazy['frames'])} frames and {len(column)} rows of {name}")
    for name in ("key", "sensor", "source", "licence"):
        if not isinstance(about[name], str):
            raise TypeError(f"{name} is {about[name]!r}, not a string")
    for name in ("object", "text"):
        if not isinstance(about[name], str | None):
            raise TypeError(f"{name} is {about[name]!r}, neither a string nor null")
    none = [math.nan] * 3
    rows = None if force is None else [none if row is None else row for row in force]
    return Recording(
        key=about["key"],
        sensor=about["sensor"],
        frames=lazy["frames"],
        times=times,
        no_contact=lazy.get("background"),
        force=None if rows is None else np.array(rows, np.float32).reshape(len(rows), 3),
        action=None if action is None else np.array(action, np.int64),
        object=about["object"],
        text=about["text"],
        image=lazy.get("image"),
        image_times=None if seen is None else np.array(seen, np.float64),
        labels=dict(about["labels"]),
        tracks=tracks,
        source=about["source"],
        tier=int(about["tier"]),
        licence=about["licence"],
    )


def _track(track: Any) -> NDArray[Any]:
    dtype = np.dtype(track["dtype"])
    if dtype.kind not in "biuf":
        raise TypeError(f"a track of {dtype}")
    return np.array(track["values"], dtype)


class PackedFrames:
    """Pictures in a shard, read and checked where they lie.

    Args:
        name: Of the recording, for messages.
        path: The shard.
        stem: What the members' names begin with.
        group: ``frames``, ``background`` or ``image``.
        codec: One of `CODECS`.
        shape: Height and width.
        starts: int64 (n,), where the header of each member begins.
        sizes: int64 (n,), bytes of each picture.
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
        self.codec = codec
        self.shape = shape
        self.starts, self.sizes, self.crcs = starts, sizes, crcs

    def __len__(self) -> int:
        return len(self.sizes)

    def encoded(self, i: int) -> bytes:
        """The bytes of one picture.

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
        block = file.read(_BLOCK + size)
        member = f"{self.stem}.{_name(self.group, i, self.codec)}"
        if block[:100].rstrip(b"\0") != member.encode():
            raise DataError(f"{self.path}: {member} of {self.name} is not there; pack it again")
        picture = block[_BLOCK:]
        if len(picture) != size or zlib.crc32(picture) != int(self.crcs[i]):
            raise DataError(
                f"{self.path}: {member} of {self.name} is damaged; download or pack it again"
            )
        return picture

    def _decoded(self, picture: bytes, i: int) -> NDArray[np.uint8]:
        found = self.shape
        try:
            found = _shape(picture)  # before anything of that size is allocated
        except (OSError, ValueError, SyntaxError, Image.DecompressionBombError) as error:
            raise DataError(f"{self.name}, {self.group} {i}: no picture ({error})") from error
        if found != self.shape:
            raise DataError(
                f"{self.name}, {self.group} {i}: {as_text(found)} pixels, where "
                f"{as_text(self.shape)} are stated; pack it again"
            )
        frame = cv2.imdecode(np.frombuffer(picture, np.uint8), cv2.IMREAD_COLOR_RGB)
        if frame is None:
            raise DataError(f"{self.name}, {self.group} {i}: cannot be decoded; pack it again")
        out: NDArray[np.uint8] = frame
        return out
