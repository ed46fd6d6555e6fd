"""Limits of what the chunks of zarr unpack to, before their decoder runs."""

from __future__ import annotations

import bz2
import lzma
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from tactileforge.errors import DataError
from tactileforge.reading import MOST_BYTES
from tactileforge_episodes.codecs import PACKERS, plain_name

#: Codecs behind a compressor that append a few bytes.
_SUMS = ("crc32", "crc32c", "adler32", "fletcher32", "jenkins_lookup3")
#: Excess of a chunk over its values: checksums and rounding of codecs.
_SLACK = 1 << 16
#: Begin of a frame of zstd, and the most bytes of a block.
_ZSTD, _BLOCK = b"\x28\xb5\x2f\xfd", 1 << 17


@dataclass
class Guard:
    """Largest size of the unpacked chunks of an array.

    Attributes:
        codec: Name of the compressor; "" for none.
        most: Most bytes of an unpacked chunk.
        where: What a read of the compressor is: ``chunk``, ``part`` of a shard, or "" for none.
    """

    codec: str = ""
    most: int = MOST_BYTES
    where: str = ""

    def check(self, where: str, content: bytes) -> None:
        """Checks the bytes of a chunk.

        Args:
            where: Name of the chunk, for messages.
            content: Its bytes.

        Raises:
            DataError: It is cut off, or unpacks to more than its values.
        """
        if self.codec == "blosc":
            said = int.from_bytes(content[12:16], "little")
            if len(content) < 16 or said > len(content):
                raise DataError(
                    f"{where}: {len(content)} bytes, where {said} are said; download it again"
                )
        if self._size(content) > self.most:
            raise DataError(
                f"{where}: {len(content)} bytes that unpack to more than its values of "
                f"{self.most} bytes; download it again"
            )

    def _size(self, content: bytes) -> int:
        if self.codec == "blosc":
            return int.from_bytes(content[4:8], "little")
        if self.codec == "lz4":
            return int.from_bytes(content[:4], "little")
        if self.codec == "zstd":
            return zstd_size(content)
        return _unpacked(self.codec, content, self.most) if self.codec else 0


def guard_of(metadata: Mapping[str, Any], values: int, any_length: bool) -> Guard:
    """The guard of an array.

    Args:
        metadata: Its ``.zarray`` (zarr 2) or ``zarr.json`` (zarr 3).
        values: Bytes of the values of a chunk.
        any_length: Whether the values are texts or bytes of any length.
    """
    most = MOST_BYTES if any_length else values + _SLACK
    codecs = [*(metadata.get("codecs") or [metadata.get("compressor") or {}])]
    where = "chunk"
    if codecs and codecs[-1].get("name") == "sharding_indexed":
        inner = codecs[-1].get("configuration") or {}
        where = "part" if inner.get("index_location", "end") == "end" else ""
        codecs = [*(inner.get("codecs") or ())]
    names = [plain_name(one.get("name") or one.get("id")) for one in codecs]
    while names and names[-1] in _SUMS:
        names.pop()
    packer = names[-1] if names and names[-1] in PACKERS else ""
    return Guard(packer, most, where if packer else "")


def zstd_size(content: bytes) -> int:
    """Bytes that zstd unpacks to (RFC 8878), without unpacking: those said, or an upper bound.

    Args:
        content: Frames of zstd. The decoder makes room for what the first of them says.
    """
    at, most, first = 0, 0, True
    while content[at : at + 4] == _ZSTD and at + 5 < len(content):
        flags = content[at + 4]
        single, dictionary = flags >> 5 & 1, (0, 1, 2, 4)[flags & 3]
        size_bytes = (single, 2, 4, 8)[flags >> 6]
        at += 5 + (not single) + dictionary
        if size_bytes and first:
            said = int.from_bytes(content[at : at + size_bytes], "little")
            return said + 256 * (size_bytes == 2)
        at, first, last = at + size_bytes, False, 0
        while not last and at + 3 <= len(content):
            header = int.from_bytes(content[at : at + 3], "little")
            last, kind, size = header & 1, header >> 1 & 3, header >> 3
            most += size if kind < 2 else _BLOCK
            at += 3 + (1 if kind == 1 else size)
        at += 4 * (flags >> 2 & 1)
    # a block may hold less than its most: such a bound says nothing of a small chunk
    return most if most > MOST_BYTES else 0


def _unpacked(codec: str, content: bytes, most: int) -> int:
    """Bytes that a chunk unpacks to, at most one beyond the limit."""
    start: Any = {
        "zlib": zlib.decompressobj,
        "gzip": lambda: zlib.decompressobj(31),
        "bz2": bz2.BZ2Decompressor,
        "lzma": lzma.LZMADecompressor,
    }[codec]
    size = 0
    try:
        while content and size <= most:
            made = start()
            size += len(made.decompress(content, most + 1 - size))
            content = made.unused_data
    except (zlib.error, OSError, lzma.LZMAError, ValueError, EOFError):
        pass  # damaged: its decoder says so
    return size
