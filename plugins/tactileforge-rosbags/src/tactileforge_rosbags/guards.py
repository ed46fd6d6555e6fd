"""Limits of bags: unpacked bytes and running SQL, before rosbags reads them."""

from __future__ import annotations

import os
import re
import sqlite3
from collections.abc import Callable, Iterator
from contextlib import closing
from functools import partial
from importlib import import_module
from mmap import ACCESS_READ, mmap
from pathlib import Path
from typing import Any, BinaryIO

from tactileforge.errors import DataError
from tactileforge.reading import MOST_BYTES, MOST_RATIO, MOST_TEXT, check_unpacked, zstd_size

#: Records of an mcap: schema, chunk, index of a chunk, and the footer, with the size of its end.
_SCHEMA, _CHUNK, _INDEX, _FOOTER = 3, 6, 8, 37
#: Bytes of the kind and the size of a record, and of a chunk's times, size and checksum.
_HEAD, _TIMES = 9, 28
_MAGIC = b"\x89MCAP0\r\n"
#: Connection, time and bytes of a message.
_Raw = tuple[Any, int, bytes]
#: Values of sqlite that are computed when they are read, in `PRAGMA table_xinfo`.
_COMPUTED = (2, 3)
#: Begin of an alias of YAML, or of its anchor.
_ALIAS = re.compile(rb"(?:^|[\s\[{,])[&*]\w", re.MULTILINE)
#: Decompressors of chunks of ROS 1, by the begin of their content.
_ROS1 = {b"BZh": "bz2:BZ2Decompressor", b"\x04\x22\x4d": "lz4.frame:LZ4FrameDecompressor"}


def check_metadata(path: Path) -> None:
    """Refuses a description of a folder with aliases, or too large to be read at once.

    Merged aliases double with every line; nothing that writes bags has any.

    Raises:
        DataError: It is too large, or has aliases.
    """
    if not path.is_file():
        return
    fix = "make it again: ros2 bag reindex"
    if (size := path.stat().st_size) > MOST_TEXT:
        raise DataError(f"{path}: {size} bytes, where {MOST_TEXT} are the limit; {fix}")
    if _ALIAS.search(path.read_bytes()):
        raise DataError(f"{path}: has aliases, which no bag has; {fix}")


def check_packed(file: Path) -> None:
    """Refuses a wholly compressed file beyond the limit of unpacking.

    Raises:
        DataError: It unpacks to too much.
    """
    if packed := file.stat().st_size:
        with file.open("rb") as raw, mmap(raw.fileno(), 0, access=ACCESS_READ) as content:
            why = check_unpacked(packed, zstd_size(content, whole=True)[0])
        if why:
            raise DataError(f"{file}: {why}; record it again, or unpack it: zstd -d")


def check_tables(file: Path) -> None:
    """Refuses a database with anything but tables of stored values.

    Views, virtual tables and generated columns run what the file says, for as long as it says.

    Raises:
        DataError: It has some; a damaged one is left to its reader.
    """
    uri = f"{file.absolute().as_uri()}?mode=ro&immutable=1"
    try:
        with closing(sqlite3.connect(uri, uri=True)) as base:
            rows = base.execute("SELECT type, name, sql FROM sqlite_master").fetchall()
            for kind, name, made in rows:
                words = str(made or "").upper().split()[:2]
                if kind not in ("table", "index") or words == ["CREATE", "VIRTUAL"]:
                    raise DataError(f"{file}: {name!r:.60} is a {kind} that runs; record it again")
                shown = base.execute("SELECT hidden FROM pragma_table_xinfo(?)", (name,))
                if any(one in _COMPUTED for (one,) in shown):
                    raise DataError(f"{file}: {name!r:.60} computes values; record it again")
    except sqlite3.Error:
        return


def limit_tables(storage: Any) -> None:
    """Has an open database give no value beyond the limit of bytes."""
    base = storage.dbconn
    base.limit(0, MOST_BYTES)  # SQLITE_LIMIT_LENGTH


def check_unindexed(file: Path) -> None:
    """Checks all chunks of an mcap without an index: opening it unpacks them.

    Raises:
        DataError: A chunk unpacks to too much.
    """
    with file.open("rb") as content:
        size = content.seek(0, os.SEEK_END)
        begin = int.from_bytes(_part(content, size - 28, 8), "little")
        if size < _FOOTER or _part(content, size - 8, 8) != _MAGIC:
            return  # its reader says so
        summary = {kind for kind, _, _ in _records(file, content, begin, size)} if begin else set()
        if {_SCHEMA, _INDEX} <= summary:
            return
        for kind, at, packed in _records(file, content, 8, size):
            if kind == _CHUNK:
                _check_record(file, content, at, packed)


def _part(file: BinaryIO, at: int, size: int) -> bytes:
    file.seek(max(0, at))
    return file.read(size)


def _records(file: Path, content: BinaryIO, at: int, size: int) -> Iterator[tuple[int, int, int]]:
    """Kind, begin and size of each record of an mcap.

    Raises:
        DataError: One has no kind: a hole in the file, of any size.
    """
    while at + _HEAD <= size - 8:
        head = _part(content, at, _HEAD)
        if not head[0]:
            raise DataError(f"{file}: no record at byte {at}; mend it: mcap recover")
        length = int.from_bytes(head[1:], "little")
        yield head[0], at + _HEAD, length
        at += _HEAD + length


def _check_record(file: Path, content: BinaryIO, at: int, size: int) -> None:
    head = _part(content, at, _TIMES + _FOOTER)
    said, name = (int.from_bytes(head[k : k + n], "little") for k, n in ((16, 8), (_TIMES, 4)))
    end = _TIMES + 4 + name
    if name > len(head) - _TIMES - 12:
        return  # its reader says so
    packed = int.from_bytes(head[end : end + 8], "little")
    coding = head[_TIMES + 4 : end].decode("latin1")
    check_chunk(f"{file}", coding, _part(content, at + end + 8, min(packed, size)), said)


def check_chunk(where: str, coding: str, content: bytes, said: int) -> None:
    """Refuses a chunk of an mcap beyond the limit, stated or unpacked.

    Args:
        where: Name of the bag.
        coding: How it is compressed; "" for not at all.
        content: Its bytes.
        said: Bytes that it says to unpack to.

    Raises:
        DataError: It is too large, or unpacks to more than it says.
    """
    why = f"{said} bytes" if said > MOST_BYTES else check_unpacked(len(content), said)
    if not why and _exceeds(coding, content, said):
        why = f"more than the {said} bytes that it says"
    if why:
        raise DataError(
            f"{where}: a chunk of {len(content)} bytes unpacks to {why}; record it again, in "
            "smaller chunks"
        )


def _exceeds(coding: str, content: bytes, most: int) -> bool:
    """Whether bytes unpack to more than a size; damaged ones do not."""
    if coding == "zstd" and zstd_size(content, whole=True)[0] > max(most, 1 << 26):
        # its bound: blocks may hold less than they can
        from backports.zstd import ZstdDecompressor, ZstdError

        return _pieces(ZstdDecompressor, ZstdError, content, most) is None
    if coding == "lz4":
        start = import_module("lz4.frame").LZ4FrameDecompressor
        return _pieces(start, RuntimeError, content, most) is None
    return False


def _pieces(start: Callable[[], Any], damage: Any, content: bytes, most: int) -> list[bytes] | None:
    """Unpacked frames, none of damaged ones; None beyond a size."""
    pieces: list[bytes] = []
    left = most
    try:
        while content and left >= 0:
            coder = start()
            pieces.append(coder.decompress(content, max_length=left + 1))
            left -= len(pieces[-1])
            if left >= 0 and not coder.eof:
                return []
            content = coder.unused_data or b""
    except (damage, EOFError, ValueError):
        return []
    return pieces if left >= 0 else None


class CheckedChunks:
    """Chunks of an mcap with an index, each checked before it is unpacked for the first time.

    Args:
        path: Path of the bag, for messages.
        storage: Its open reader.
    """

    def __init__(self, path: str, storage: Any) -> None:
        self.path, self.storage = path, storage
        self._read: Callable[..., Iterator[_Raw]] = storage.messages
        self._seen: set[int] = set()
        starts = [one.chunk_start_offset for one in storage.chunks]
        if len({*starts}) < len(starts):
            raise DataError(f"{path}: its index names a chunk twice; mend it: mcap recover")

    def messages(
        self, connections: Any, start: int | None = None, stop: int | None = None
    ) -> Iterator[_Raw]:
        """Messages, as of the reader.

        Raises:
            DataError: A chunk unpacks to too much.
        """
        for one in self.storage.chunks:
            apart = (start is not None and one.message_end_time < start) or (
                stop is not None and one.message_start_time >= stop
            )
            if one.chunk_start_offset not in self._seen and not apart:
                self._check(one)
                self._seen.add(one.chunk_start_offset)
        yield from self._read(connections, start, stop)

    def _check(self, chunk: Any) -> None:
        begin = chunk.chunk_start_offset + _HEAD + _TIMES + 12 + len(chunk.compression)
        if begin + chunk.compressed_size > Path(self.storage.path).stat().st_size:
            raise DataError(f"{self.path}: its index names a chunk that is not there; mcap recover")
        with Path(self.storage.path).open("rb") as file:
            file.seek(begin)
            content = file.read(chunk.compressed_size)
        check_chunk(self.path, chunk.compression, content, chunk.uncompressed_size)


def limit_chunks(path: str, reader: Any) -> None:
    """Has an open bag of ROS 1 unpack its chunks within the limits.

    Raises:
        DataError: Its index names a chunk twice.
    """
    if len(reader.chunks) < len(reader.chunk_infos):
        raise DataError(f"{path}: its index names a chunk twice; mend it: rosbag reindex")
    for place, chunk in reader.chunks.items():
        reader.chunks[place] = chunk._replace(
            decompressor=partial(_unpacked, path, chunk.decompressor)
        )


def _unpacked(path: str, unpack: Callable[[bytes], bytes], content: bytes) -> bytes:
    """A chunk of ROS 1, unpacked within the limits.

    Raises:
        DataError: It is not.
    """
    most = min(MOST_BYTES, max(1 << 26, len(content) * MOST_RATIO))
    if coder := _ROS1.get(content[:3]):
        module, _, name = coder.partition(":")
        start = getattr(import_module(module), name)
        pieces = _pieces(start, (OSError, RuntimeError), content, most)
        if pieces is None:
            raise DataError(
                f"{path}: a chunk of {len(content)} bytes unpacks to more than {most}; record it "
                "again, in smaller chunks"
            )
        if pieces:
            return b"".join(pieces)
    return unpack(content)
