"""Shards: plain tar files of recordings, readable by any tool (`docs/shards.md`).

A recording is ``KEY.json`` (all but the images), ``KEY.background.0000.jpg`` and on,
``KEY.image.0000.jpg`` and on, ``KEY.surface.0000.png`` and on, and ``KEY.0000.jpg`` and on. The
JSON states the size and checksum of each image. So a shard is opened by reading its JSON alone, and
images are read and checked in place.
"""

from __future__ import annotations

import io
import json
import logging
import os
import re
import tarfile
import zlib
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from tactileforge.contracts import Recording
from tactileforge.data.frames.image_codecs import (
    CODECS,
    GROUPS,
    TAR_BLOCK,
    PackedFrames,
    check_upright,
    encode_image,
    image_size,
    member_name,
)
from tactileforge.data.shards.description import (
    SHARD_VERSION,
    WRONG,
    build_recording,
    checksum,
    describe_recording,
    parse_description,
)
from tactileforge.data.shards.foreign import check_foreign
from tactileforge.errors import DataError
from tactileforge.util.files import new_part
from tactileforge.util.regular import open_regular
from tactileforge.util.untrusted import MAX_PIXELS

log = logging.getLogger(__name__)

__all__ = [
    "CODECS",
    "SHARD_VERSION",
    "Packed",
    "PackedFrames",
    "describe_recording",
    "encode_image",
    "read_shard",
    "write_shard",
]

_JSON = re.compile(r"\d{6,}\.json")
#: Largest JSON and largest image to read, bytes: a damaged size must not fill the memory.
_MAX_JSON, _MAX_PICTURE = 1 << 26, 1 << 28


@dataclass(frozen=True)
class Packed:
    """A recording with encoded images.

    Attributes:
        head: Description of the recording, as plain data.
        codec: Codec of the images, one of `CODECS`.
        frames: Encoded frames.
        background: Encoded frames without contact; [] for none.
        image: Encoded camera images; [] for none.
        surface: Encoded displacements of the surface, PNG; [] for none.
    """

    head: dict[str, Any]
    codec: str
    frames: Sequence[bytes]
    background: Sequence[bytes]
    image: Sequence[bytes]
    surface: Sequence[bytes] = ()


def write_shard(path: Path, recordings: Iterable[Packed]) -> None:
    """Write a shard: beside its place, then renamed. The same content gives the same bytes.

    Raises:
        DataError: A recording has an infinite number, or a NaN among its times.
    """
    with new_part(path) as part:
        with tarfile.open(part, "w", format=tarfile.USTAR_FORMAT) as tar:
            for number, packed in enumerate(recordings):
                _add(tar, f"{number:06d}", packed)
        part.replace(path)


def _add(tar: tarfile.TarFile, stem: str, packed: Packed) -> None:
    def member(name: str, content: bytes) -> None:
        # TarInfo's defaults have no time and no owner, so equal content gives equal bytes
        info = tarfile.TarInfo(f"{stem}.{name}")
        info.size = len(content)
        tar.addfile(info, io.BytesIO(content))

    pictures = {group: getattr(packed, group) for group in GROUPS if getattr(packed, group)}

    for group, encoded in pictures.items():
        for number, picture in enumerate(encoded):
            check_upright(picture, f"{stem}.{member_name(group, number, packed.codec)}")
    about = packed.head | {
        "codec": packed.codec,
        "pictures": {
            group: {
                "shape": image_size(encoded[0]),
                "bytes": [len(picture) for picture in encoded],
                "crc32": [zlib.crc32(picture) for picture in encoded],
            }
            for group, encoded in pictures.items()
        },
    }
    try:
        text = json.dumps(about | {"crc32": checksum(about)}, allow_nan=False)
    except ValueError as error:
        raise DataError(
            f"{about['key']}: its times, forces, labels or tracks have a number that no JSON has "
            f"({error}); correct it"
        ) from error
    member("json", text.encode())
    for group, encoded in pictures.items():
        for number, picture in enumerate(encoded):
            member(member_name(group, number, packed.codec), picture)


def _raise(error: DataError) -> None:
    raise error


def read_shard(path: Path, bad: Callable[[DataError], None] = _raise) -> Iterator[Recording]:
    """Read the recordings of a shard; reads no image.

    Args:
        path: Path of the shard.
        bad: Callback for a damaged recording or a truncated file; the others are yielded all the
            same. The default raises the error.

    Raises:
        DataError: The file is not a shard, or one of another version or program.
    """
    try:
        with os.fdopen(open_regular(path), "rb") as file:
            yield from _scan(file, path, bad)
    except OSError as error:
        raise DataError(f"{path}: cannot be read ({error}); download or pack it again") from error


def _scan(file: BinaryIO, path: Path, bad: Callable[[DataError], None]) -> Iterator[Recording]:
    # Two positions: `place` trusts the sizes of the JSON and jumps over the images; `pictures` is
    # the first image, to go on member by member if nothing lies where the JSON says.
    size = os.fstat(file.fileno()).st_size
    place = pictures = found = 0
    while True:
        try:
            member = _member(file, path, place)
        except DataError:
            if place == pictures:
                raise
            place = pictures  # the sizes were wrong: go from member to member
            continue
        if member is None:
            break
        name, length = member
        start, place = place + TAR_BLOCK, place + TAR_BLOCK + _padded(length)
        pictures = place
        if not _JSON.fullmatch(name):  # an image, after a damaged description
            if ".." in name or name.startswith("/"):
                text = f"{path}: a member is called {name!r}; this is not a tactileforge shard"
                bad(DataError(text))
            continue
        if length > _MAX_JSON:
            bad(DataError(f"{path}:{name}: a description of {length} bytes; pack it again"))
            continue
        if place > size:
            break
        try:
            about = parse_description(file.read(length), f"{path}:{name}")
            recording, place = _recording(path, name.removesuffix(".json"), about, start + length)
        except DataError as error:
            if not found:
                check_foreign(path)
            bad(error)
            continue
        if place > size:
            break
        found += 1
        yield recording
    if not found:
        check_foreign(path)
    if place + TAR_BLOCK > size:  # a whole tar ends with two blocks of zeros (POSIX ustar)
        bad(DataError(f"{path}: cut off at byte {size}; download or pack it again"))


def _member(file: BinaryIO, path: Path, place: int) -> tuple[str, int] | None:
    """Name and size of the member at a position; None at the end."""
    file.seek(place)
    block = file.read(TAR_BLOCK)
    if len(block) < TAR_BLOCK or not block.strip(b"\0"):
        return None
    try:
        info = tarfile.TarInfo.frombuf(block, "utf-8", "surrogateescape")
    except tarfile.HeaderError as error:
        raise DataError(f"{path}: no tar at byte {place} ({error}); pack it again") from error
    if not 0 <= info.size < 1 << 60:  # base-256 sizes may be negative or beyond a seek
        raise DataError(f"{path}: a member of {info.size} bytes at byte {place}; pack it again")
    return info.name, info.size


def is_whole(path: Path) -> bool:
    """Whether a shard exists with undamaged descriptions and pictures."""
    if not path.is_file():
        return False
    try:
        for recording in read_shard(path):
            for frames in (recording.frames, recording.no_contact, recording.image):
                for place in range(len(frames) if isinstance(frames, PackedFrames) else 0):
                    frames.encoded(place)  # type: ignore[union-attr]
    except DataError:
        return False
    return True


def keep_whole(paths: Iterable[Path]) -> list[str]:
    """Remove damaged shards, to be made anew; returns their names."""
    damaged = [path for path in paths if path.exists() and not is_whole(path)]
    for path in damaged:
        log.warning("%s: damaged, so it is made anew", path)
        path.unlink()
    return [path.name for path in damaged]


def shard_members(path: Path) -> Iterator[tuple[str, bytes]]:
    """Yield the names and contents of the members of a tar file.

    Raises:
        DataError: The file is not a tar file, or truncated.
    """
    with os.fdopen(open_regular(path), "rb") as file:
        place, size = 0, os.fstat(file.fileno()).st_size
        while (member := _member(file, path, place)) is not None:
            name, length = member
            if place + TAR_BLOCK + length > size:
                raise DataError(f"{path}: cut off at byte {size}; download or pack it again")
            yield name, file.read(length)
            place += TAR_BLOCK + _padded(length)


def _padded(size: int) -> int:
    return -(-size // TAR_BLOCK) * TAR_BLOCK


def _recording(path: Path, stem: str, about: Any, place: int) -> tuple[Recording, int]:
    """Recording of a description with its JSON up to a position, and the end of its images."""
    where = f"{path}:{about.get('key', stem)}"
    place = _padded(place)
    try:
        lazy = {}
        for group in GROUPS:
            if group not in about["pictures"]:
                continue
            table = about["pictures"][group]
            sizes = np.array(table["bytes"], np.int64)
            crcs = np.array(table["crc32"], np.uint32)
            if not len(sizes) or sizes.shape != crcs.shape:
                raise ValueError(f"{group}: {len(sizes)} sizes, {len(crcs)} checksums")
            if sizes.min() < 0 or sizes.max() > _MAX_PICTURE:
                raise ValueError(f"{group}: a picture of {sizes.min()} or {sizes.max()} bytes")
            ends = place + np.cumsum(TAR_BLOCK + -(-sizes // TAR_BLOCK) * TAR_BLOCK)
            starts = np.concatenate([[place], ends[:-1]])
            place = int(ends[-1])
            height, width = map(int, table["shape"])
            if min(height, width) < 1 or height * width > MAX_PIXELS:
                raise ValueError(f"{group}: {height} x {width} pixels")
            lazy[group] = PackedFrames(
                where, path, stem, group, about["codec"], (height, width), starts, sizes, crcs
            )
        return build_recording(about, lazy), place
    except WRONG as error:
        raise DataError(f"{where}: its description is wrong ({error!r}); pack it again") from error
