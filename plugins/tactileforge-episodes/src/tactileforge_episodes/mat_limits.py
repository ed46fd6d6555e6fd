"""Limits of MATLAB 5 files: unpacked bytes, and stated sizes."""

from __future__ import annotations

import zlib
from math import prod
from typing import IO

import numpy as np

from tactileforge.errors import DataError
from tactileforge.reading import DEEPEST, check_unpacked
from tactileforge_episodes.slices import Slice

#: Types of elements: an array, and packed ones.
_MATRIX, _PACKED = 14, 15
#: Classes of arrays that hold arrays: cells, structs and objects.
_HOLDERS = (1, 2, 3)
#: Class of sparse arrays, whose places scipy believes.
_SPARSE = 5
#: Most bytes of an unpacked variable whose inner arrays are looked at; of larger ones, the first.
_LOOKED = 1 << 26
_HEADER = 128


def check_mat5(name: str, file: IO[bytes] | Slice) -> None:
    """Refuses variables larger than the limit, or than their bytes can hold.

    Args:
        name: Path of the file, for messages.
        file: The open file, of MATLAB before 7.3; at its begin, where it is left.

    Raises:
        DataError: A variable is too large; a damaged one is left to its reader.
    """
    head = file.read(_HEADER)
    if 0 in head[:4]:
        _check_mat4(name, file)
    order = {b"IM": "<", b"MI": ">"}.get(head[126:])
    while order and len(tag := file.read(8)) == 8:
        kind, size = (int(one) for one in np.frombuffer(tag, f"{order}u4"))
        if kind == _PACKED:
            content = _unpacked(name, file.read(size))
        elif kind == _MATRIX:
            content = tag + file.read(min(size, _LOOKED))
            file.seek(max(0, size - _LOOKED), 1)
        else:
            break
        _look(name, content, order)
    file.seek(0)


def _check_mat4(name: str, file: IO[bytes] | Slice) -> None:
    """Refuses variables of version 4 with more values than bytes.

    Raises:
        DataError: There are fewer bytes.
    """
    end, at = file.seek(0, 2), 0
    while at + 20 <= end:
        file.seek(at)
        head = file.read(20)
        swapped = not 0 <= int.from_bytes(head[:4], "little") <= 5000
        kind, rows, columns, parts, length = np.frombuffer(head, ">i4" if swapped else "<i4")
        item = {0: 8, 1: 4, 2: 4, 3: 2, 4: 2, 5: 1}.get(int(kind) // 10 % 10, 8)
        size = int(rows) * int(columns) * item * (2 if parts else 1) + int(length)
        if min(rows, columns, length) < 0 or at + 20 + size > end:
            raise DataError(f"{name}: a variable of {rows} x {columns} values, and no such bytes")
        at += 20 + size


def _unpacked(name: str, packed: bytes) -> bytes:
    """Begin of a packed variable.

    Raises:
        DataError: All of it is too much.
    """
    coder, size, begin, rest = zlib.decompressobj(), 0, b"", packed
    try:
        while rest and not coder.eof:
            part = coder.decompress(rest, _LOOKED)
            size += len(part)
            begin = begin or part
            rest = coder.unconsumed_tail
            if why := check_unpacked(len(packed), size):
                raise DataError(f"{name}: {why}; save it again")
    except zlib.error:
        pass  # its reader says so
    return begin


def _look(name: str, content: bytes, order: str, depth: int = 0) -> None:
    """Looks at an array and the arrays within it."""
    at = 0
    while at + 8 <= len(content):
        kind, size, begin = _tag(content, at, order)
        if kind == _MATRIX:
            _look_at(name, content[begin : begin + size], size, order, depth)
        at = begin + size + (-size % 8 if begin == at + 8 else 4 - size)


def _look_at(name: str, content: bytes, size: int, order: str, depth: int) -> None:
    if depth > DEEPEST:
        raise DataError(f"{name}: more than {DEEPEST} structs and cells in each other")
    if len(content) < 32:
        return
    holder = int(np.frombuffer(content[8:12], f"{order}u4")[0]) & 0xFF
    if holder == _SPARSE and depth:
        raise DataError(f"{name}: a sparse array in a struct or cell; save it as a full one")
    if holder not in _HOLDERS:
        return
    _, length, begin = _tag(content, 16, order)
    sizes = [int(one) for one in np.frombuffer(content[begin : begin + length], f"{order}i4")]
    if prod(sizes) * 8 > size:
        raise DataError(
            f"{name}: {prod(sizes)} cells or structs in {size} bytes: damaged; save it again"
        )
    _look(name, content, order, depth + 1)


def _tag(content: bytes, at: int, order: str) -> tuple[int, int, int]:
    """Type, size and first byte of an element."""
    kind, size = (int(one) for one in np.frombuffer(content[at : at + 8], f"{order}u4"))
    if kind >> 16:  # small: both in four bytes, and the values behind them
        return kind & 0xFFFF, min(kind >> 16, 4), at + 4
    return kind, size, at + 8
