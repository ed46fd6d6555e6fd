"""Containers of other people's data: where values are, never what they mean."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from mmap import mmap
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from tactileforge.contracts.data import Frames
from tactileforge.errors import DataError

#: Most arrays of a container, and deepest group that is looked into.
MOST_KEYS = 100_000
DEEPEST = 32
#: Most bytes that are decoded together: a chunk, a row, or a file that is read whole.
MOST_BYTES = 1 << 28
#: Most bytes of a description: metadata, attributes and the like.
MOST_TEXT = 1 << 24
#: Most bytes of a compressed file that is unpacked to disk.
MOST_UNPACKED = 1 << 33
#: Largest ratio of unpacked bytes to packed ones, beyond 64 MB.
MOST_RATIO = 50
#: Most bytes of an array, which no disk holds.
_MOST = 1 << 50
#: Begin of a frame of zstd, and the most bytes of a block.
_ZSTD, _BLOCK = b"\x28\xb5\x2f\xfd", 1 << 17


@dataclass(frozen=True)
class Facts:
    """Description of an array.

    Attributes:
        shape: Its sizes; the first is time, but for an array without rows.
        dtype: Type of its values; ``object`` for texts or bytes of any length.
        block: Rows that are decoded together.
    """

    shape: tuple[int, ...]
    dtype: np.dtype[Any]
    block: int = 1

    @property
    def rows(self) -> int:
        """Number of rows; 1 for a single value."""
        return self.shape[0] if self.shape else 1


class Values(Protocol):
    """An array of a container, read in part."""

    @property
    def facts(self) -> Facts:
        """Shape and type."""
        ...

    def rows(self, rows: Sequence[int] | NDArray[np.int64]) -> NDArray[Any]:
        """Some rows, in the order asked for.

        Raises:
            DataError: A row is damaged, or not there.
        """
        ...


@runtime_checkable
class Container(Protocol):
    """A file, group or folder with values by name.

    A container says where values are. Which of them is touch, force or time is said by a map, or
    guessed from names and shapes. So a format is four methods, and `testing.check_container` is
    their test.
    """

    def keys(self) -> list[str]:
        """Names of the arrays, in order, with ``/`` between groups.

        Raises:
            DataError: The container is damaged, or has more than `MOST_KEYS` arrays.
        """
        ...

    def array(self, key: str) -> Values:
        """An array by its name; nothing but its description is read.

        Raises:
            DataError: It is missing, damaged, or larger than `check_size` allows.
        """
        ...

    def times(self, key: str) -> NDArray[np.float64] | None:
        """Times of the rows of an array, s, where the format itself has them; else None.

        Bags stamp each message. Arrays of zarr, HDF5, npz and parquet have no times: a map says
        which other array holds them.
        """
        ...

    def frames(self, key: str) -> Frames | None:
        """Pictures of an array, one per row, RGB; None where it holds none.

        Raises:
            DataError: The array is missing or damaged.
        """
        ...


def check_size(where: str, shape: Sequence[int], dtype: np.dtype[Any], block: Sequence[int]) -> str:
    """Why an array is not read, "" for none: its sizes are impossible, or too much at once.

    Args:
        where: Name of what is decoded together, such as ``chunks``.
        shape: Sizes of the array.
        dtype: Type of its values.
        block: Sizes of what is decoded together; () for single rows.

    Example:
        >>> check_size("chunks", (40, 3), np.dtype("f4"), (0, 3))
        'shape (40, 3) in chunks of (0, 3)'
    """
    said = f"shape {tuple(shape)}" + (f" in {where} of {tuple(block)}" if block else "")
    item = dtype.itemsize or 1
    if any(size < 0 for size in shape) or any(size < 1 for size in block):
        return said
    if math.prod(shape) * item > _MOST:
        return f"{said}: more than any disk holds"
    at_once = max(math.prod(block), math.prod(shape[1:])) * item
    if math.prod(shape) and at_once > MOST_BYTES:
        return f"{said}: {at_once >> 20} MB at once, where {MOST_BYTES >> 20} MB are the limit"
    return ""


def check_unpacked(packed: int, unpacked: int) -> str:
    """Why a compressed file is not unpacked, "" for none.

    Args:
        packed: Bytes of the file.
        unpacked: Bytes that it says to hold.

    Example:
        >>> check_unpacked(200_000, 6_000_000_000)
        '6000000000 bytes unpacked from 200000: no data compress so well'
    """
    if unpacked > MOST_UNPACKED:
        return f"{unpacked} bytes unpacked, where {MOST_UNPACKED} are the limit"
    if unpacked > max(1 << 26, packed * MOST_RATIO):
        return f"{unpacked} bytes unpacked from {packed}: no data compress so well"
    return ""


def zstd_size(content: bytes | mmap, whole: bool = False) -> tuple[int, bool]:
    """Size of unpacked zstd (RFC 8878), bytes, without unpacking; and whether it is a bound.

    Args:
        content: Frames of zstd. A decoder makes room for what the first of them says.
        whole: Whether the upper bound of all frames is wanted, whatever the first says: a stream
            is unpacked before that is found to be wrong.

    Example:
        >>> zstd_size(bytes.fromhex("28b52ffd20051900007469676572"))
        (5, False)
    """
    at, most, first = 0, 0, not whole
    while content[at : at + 4] == _ZSTD and at + 5 < len(content):
        flags = content[at + 4]
        single, dictionary = flags >> 5 & 1, (0, 1, 2, 4)[flags & 3]
        size_bytes = (single, 2, 4, 8)[flags >> 6]
        at += 5 + (not single) + dictionary
        if size_bytes and first:
            said = int.from_bytes(content[at : at + size_bytes], "little")
            return said + 256 * (size_bytes == 2), False
        at, first, last = at + size_bytes, False, 0
        while not last and at + 3 <= len(content):
            header = int.from_bytes(content[at : at + 3], "little")
            last, kind, size = header & 1, header >> 1 & 3, header >> 3
            most += size if kind < 2 else _BLOCK
            at += 3 + (1 if kind == 1 else size)
        at += 4 * (flags >> 2 & 1)
    return most, True


def check_keys(where: object, count: int) -> None:
    """Refuses a container with more arrays than anyone names.

    Args:
        where: Name of the container.
        count: Number of arrays and groups so far.

    Raises:
        DataError: There are more than `MOST_KEYS`.
    """
    if count > MOST_KEYS:
        raise DataError(
            f"{where}: more than {MOST_KEYS} arrays and groups; give a part of it, or download it "
            "again"
        )
