"""Limits of unpacked chunks of zarr, before their decoder runs."""

from __future__ import annotations

import bz2
import lzma
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from tactileforge.errors import DataError
from tactileforge.reading import MOST_BYTES, zstd_size
from tactileforge_episodes.codecs import PACKERS, plain_name

#: Codecs behind a compressor that append a few bytes.
_SUMS = ("crc32", "crc32c", "adler32", "fletcher32", "jenkins_lookup3")
#: Excess of a chunk over its values: checksums and rounding of codecs.
_SLACK = 1 << 16


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
            # a block may hold less than its most: such a bound says nothing of a small chunk
            size, is_bound = zstd_size(content)
            return 0 if is_bound and size <= MOST_BYTES else size
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


def _unpacked(codec: str, content: bytes, most: int) -> int:
    """Unpacked bytes of a chunk, at most one beyond the limit."""
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
