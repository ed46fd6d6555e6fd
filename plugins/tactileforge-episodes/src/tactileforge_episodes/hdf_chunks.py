"""Bombs among the chunks of HDF5, found before the library unpacks them."""

from __future__ import annotations

from collections.abc import Iterator
from math import prod
from typing import TYPE_CHECKING, Any

import numpy as np

from tactileforge.errors import DataError
from tactileforge.reading import MOST_BYTES
from tactileforge_episodes.guards import Guard

if TYPE_CHECKING:
    from h5py import Dataset

#: Filters that unpack, by their numbers, and how far one byte may expand; None for any number.
_DEFLATE, _LZF, _LZ4, _BITSHUFFLE = 1, 32000, 32004, 32008
_PACKERS: dict[int, int | None] = {
    _DEFLATE: 1032,
    _LZF: 88,
    **dict.fromkeys((307, 32001, _LZ4, _BITSHUFFLE, 32015), None),
}
_CODECS = {_DEFLATE: "zlib", 307: "bz2", 32001: "blosc", 32015: "zstd"}
#: Bytes by which checksums and rounding of filters exceed the values of a chunk.
_SLACK = 1 << 16
#: Bytes that a chunk of lzf may unpack to without a count: the filter begins anew where it exceeds.
_SMALL = 1 << 22


class Chunks:
    """Packed chunks of a data set, each looked at before it is unpacked for the first time.

    Args:
        where: Name of the data set, for messages.
        found: The data set.

    Raises:
        DataError: It is compressed twice, so that no chunk bounds what it unpacks to.
    """

    def __init__(self, where: str, found: Dataset) -> None:
        self.where, self.found = where, found
        packers = [number for number in _filters(found) if number in _PACKERS]
        if len(packers) > 1:
            raise DataError(f"{where}: compressed twice; write it again")
        self.packer = packers[0] if packers else 0
        self.most = prod(found.chunks or ()) * found.dtype.itemsize + _SLACK
        self._doubtful = {} if not packers else dict(self._listed())

    def _listed(self) -> Iterator[tuple[tuple[int, ...], int]]:
        """Corner and mask of each chunk of doubtful size."""
        seen: list[Any] = []
        self.found.id.chunk_iter(seen.append)
        ratio = _PACKERS[self.packer]
        free = _SMALL if self.packer == _LZF else MOST_BYTES
        for one in seen:
            if ratio is None or one.size * ratio > free:
                yield one.chunk_offset, one.filter_mask

    def check(self, start: int, stop: int) -> None:
        """Looks at the chunks of some rows.

        Args:
            start: First row.
            stop: Row after the last.

        Raises:
            DataError: A chunk unpacks to more than its values.
        """
        step = self.found.chunks[0] if self.found.chunks else 1
        for corner in [one for one in self._doubtful if one[0] < stop and one[0] + step > start]:
            _, content = self.found.id.read_direct_chunk(corner)
            if not self._doubtful[corner]:  # otherwise a filter was left out for this chunk
                self._look(f"{self.where}, chunk at {corner}", content)
            del self._doubtful[corner]

    def _look(self, where: str, content: bytes) -> None:
        if self.packer == _LZF:
            if lzf_size(content, self.most) > self.most:
                raise DataError(
                    f"{where}: {len(content)} bytes that unpack to more than its values of "
                    f"{self.most} bytes; download it again"
                )
        elif self.packer in _CODECS:
            Guard(_CODECS[self.packer], self.most).check(where, content)
        elif int.from_bytes(content[:8], "big") > self.most:
            raise DataError(f"{where}: says more than its values of {self.most} bytes")


def _filters(found: Dataset) -> list[int]:
    about = found.id.get_create_plist()
    filters = [about.get_filter(i) for i in range(about.get_nfilters())]
    # bitshuffle packs where its fifth value names a coder
    return [number for number, _, said, _ in filters if number != _BITSHUFFLE or any(said[4:5])]


def lzf_size(content: bytes, most: int) -> int:
    """Bytes of a chunk of lzf, unpacked, or a bound of them within a limit.

    Args:
        content: The chunk: runs of literals, and repeats of 2 or 3 bytes.
        most: The limit.

    Example:
        >>> lzf_size(bytes([0, 7, 0xE0, 255, 0]), 100)
        265
    """
    raw = np.frombuffer(content, np.uint8)
    # a byte of 224 or more may begin a repeat as long as the next one says, and 9 more
    long = raw[1:][raw[:-1] >= 224]
    bound = 4 * len(raw) + int(long.sum(dtype=np.int64)) + 9 * len(long)
    if bound <= most:
        return bound
    at, size = 0, 0
    while at < len(content) and size <= most:
        begin = content[at]
        if begin < 32:
            size += begin + 1
            at += begin + 2
        elif begin < 224:
            size += (begin >> 5) + 2
            at += 2
        else:
            size += (content[at + 1] if at + 1 < len(content) else 0) + 9
            at += 3
    return size
