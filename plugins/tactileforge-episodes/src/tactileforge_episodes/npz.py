"""Arrays of npz files, alone or in an archive; pickled ones are refused."""

from __future__ import annotations

import os
import tempfile
import zipfile
from collections.abc import Callable
from dataclasses import dataclass
from math import prod
from typing import Any

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from tactileforge.errors import DataError
from tactileforge.reading import (
    MOST_BYTES,
    Facts,
    check_keys,
    check_size,
    check_unpacked,
)
from tactileforge_episodes.arrays import ArrayFile
from tactileforge_episodes.members import DAMAGED, stored_part
from tactileforge_episodes.slices import Handle, Slice

#: Bytes that are unpacked at once.
_STEP = 1 << 22
#: Readers of the header of an npy file, by its version.
_HEADERS: dict[tuple[int, int], Callable[..., Any]] = {
    (1, 0): npy.read_array_header_1_0,
    (2, 0): npy.read_array_header_2_0,
}


@dataclass(frozen=True)
class _Entry:
    """Place of an array.

    Attributes:
        start: First byte of its values in the member.
        size: Bytes of its values.
        by_columns: Whether its first axis changes fastest, so that no row lies in one piece.
    """

    start: int
    size: int
    by_columns: bool


class NpzFile(ArrayFile):
    """Arrays of an npz file; rows of uncompressed ones are read alone.

    Args:
        name: Path of the file, for messages.
        file: The open file.

    Raises:
        DataError: It is not an npz file.
    """

    def __init__(self, name: str, file: Slice) -> None:
        super().__init__(name)
        self._file = file
        try:
            self._archive = zipfile.ZipFile(file)
            self._names = {
                entry.filename.removesuffix(".npy"): entry for entry in self._archive.infolist()
            }
        except DAMAGED as error:
            raise DataError(f"{name}: not a readable npz file ({error}); download it again") from (
                error
            )
        self._entries: dict[str, _Entry] = {}
        self._contents: dict[str, Slice] = {}

    def _list(self) -> list[str]:
        check_keys(self.name, len(self._names))
        return [*self._names]

    def _look(self, key: str) -> Facts:
        entry = self._names[key]
        with self._archive.open(entry) as member:
            version = npy.read_magic(member)
            if version not in _HEADERS:
                raise self._wrong(key, f"npy version {version}")
            shape, fortran, dtype = _HEADERS[version](member)
            header = member.tell()
        if dtype.hasobject:
            raise DataError(
                f"{self.name}, {key}: holds Python objects as a pickle, which can run code, so it "
                "is not read; save it with a fixed type, or leave it out of the map"
            )
        size = dtype.itemsize * prod(shape)
        if why := check_size("", shape, dtype, ()):
            raise self._wrong(key, why)
        if dtype.names or header + size != entry.file_size:
            raise self._wrong(key, f"{dtype} {shape} in {entry.file_size} bytes")
        by_columns = fortran and len(shape) > 1
        if by_columns and size > MOST_BYTES:
            raise self._wrong(
                key,
                f"{size} bytes column by column, of which no row can be read alone; save it "
                "with np.ascontiguousarray",
            )
        self._entries[key] = _Entry(header, size, by_columns)
        if entry.compress_type == zipfile.ZIP_STORED:
            self._values(key)  # its place is known before its rows are asked for
        return Facts(tuple(shape), dtype, max(1, shape[0]) if by_columns else 1)

    def _values(self, key: str) -> Slice:
        """Bytes of the values of an array; a compressed one is unpacked once."""
        if key not in self._contents:
            about = self._entries[key]
            self._contents[key] = self._content(key).part(about.start, about.size)
        return self._contents[key]

    def _content(self, key: str) -> Slice:
        """Bytes of a member; a compressed one is unpacked once, into a file without a name."""
        entry = self._names[key]
        if entry.compress_type == zipfile.ZIP_STORED:
            return stored_part(self._file, entry)
        why = check_unpacked(entry.compress_size, entry.file_size)
        if entry.compress_type != zipfile.ZIP_DEFLATED:
            why = f"compressed by method {entry.compress_type}; save it with np.savez"
        if why:
            raise self._wrong(key, why)
        with self._archive.open(entry) as member, tempfile.TemporaryFile() as unpacked:
            while block := member.read(_STEP):
                unpacked.write(block)
            unpacked.flush()
            return Slice(Handle.of(os.dup(unpacked.fileno())))

    def _rows(self, key: str, facts: Facts, start: int, stop: int) -> NDArray[Any]:
        values = self._values(key)
        if self._entries[key].by_columns:
            whole = np.frombuffer(values.part(0, self._entries[key].size).read(), facts.dtype)
            return whole.reshape(facts.shape, order="F")[start:stop]
        row = facts.dtype.itemsize * prod(facts.shape[1:])
        count = min(stop, facts.rows) - start
        raw = values.part(start * row, count * row).read()
        if len(raw) != count * row:
            raise ValueError("cut off")
        return np.frombuffer(raw, facts.dtype).reshape(
            (count, *facts.shape[1:])[: len(facts.shape)]
        )
