"""Arrays of npz files, alone or in an archive; pickled ones are refused."""

from __future__ import annotations

import io
import struct
import threading
import zipfile
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from tokenize import TokenError
from typing import Any

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from tactileforge.plugin import DataError
from tactileforge_episodes.arrays import Facts, is_sane
from tactileforge_episodes.members import Slice

_DAMAGED = (
    *(zipfile.BadZipFile, zlib.error, OSError, EOFError, RuntimeError, NotImplementedError),
    *(ValueError, TypeError, KeyError, OverflowError, MemoryError, SyntaxError),
    TokenError,  # numpy reads headers as literals of Python
)
_LOCAL = struct.Struct("<26xHH")
#: Readers of the header of an npy file, by its version.
_HEADERS: dict[tuple[int, int], Callable[..., Any]] = {
    (1, 0): npy.read_array_header_1_0,
    (2, 0): npy.read_array_header_2_0,
}


@dataclass(frozen=True)
class _Entry:
    """Place of an array.

    Attributes:
        start: First byte of its values in the file; None where it is compressed.
        fortran: Whether its first axis changes fastest.
    """

    start: int | None
    fortran: bool


class NpzFile:
    """Arrays of an npz file; rows of uncompressed ones are read alone.

    Args:
        name: Path of the file, for messages.
        file: The open file.

    Raises:
        DataError: It is no npz file.
    """

    def __init__(self, name: str, file: Slice) -> None:
        self.name, self._file, self._lock = name, file, threading.Lock()
        try:
            self._archive = zipfile.ZipFile(file)
            self._names = {
                entry.filename.removesuffix(".npy"): entry for entry in self._archive.infolist()
            }
        except _DAMAGED as error:
            raise DataError(f"{name}: not a readable npz file ({error}); download it again") from (
                error
            )
        self._entries: dict[str, _Entry] = {}
        self._facts: dict[str, Facts] = {}

    def keys(self) -> list[str]:
        """Names of the arrays, in order."""
        return sorted(self._names)

    def facts(self, key: str) -> Facts:
        """Shape and type of an array.

        Raises:
            DataError: It is missing, damaged, or pickled.
        """
        if key not in self._facts:
            try:
                self._facts[key] = self._look(key)
            except _DAMAGED as error:
                raise self._wrong(key, str(error)) from error
        return self._facts[key]

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
        size = dtype.itemsize * int(np.prod(shape, dtype=np.int64))
        if not is_sane(shape, dtype) or dtype.names or header + size != entry.file_size:
            raise self._wrong(key, f"{dtype} {shape} in {entry.file_size} bytes")
        start = None
        if entry.compress_type == zipfile.ZIP_STORED:
            self._file.seek(entry.header_offset)
            start = entry.header_offset + _LOCAL.size + header
            start += sum(_LOCAL.unpack(self._file.read(_LOCAL.size)))
        self._entries[key] = _Entry(start, fortran)
        lazy = start is not None and not (fortran and len(shape) > 1)
        return Facts(tuple(shape), dtype, 1 if lazy else max(1, shape[0] if shape else 1))

    def read(self, key: str, start: int, stop: int) -> NDArray[Any]:
        """Rows of an array; all of one without rows.

        Raises:
            DataError: The array is damaged.
        """
        facts = self.facts(key)
        entry = self._entries[key]
        try:
            if entry.start is None or entry.fortran:
                with self._archive.open(self._names[key]) as member:
                    content = io.BytesIO(member.read())
                values = npy.read_array(content, allow_pickle=False)
                return np.asarray(values[start:stop] if facts.shape else values)
            row = facts.dtype.itemsize * int(np.prod(facts.shape[1:], dtype=np.int64))
            count = min(stop, facts.rows) - start
            with self._lock:
                self._file.seek(entry.start + start * row)
                raw = self._file.read(count * row)
            shape = (count, *facts.shape[1:]) if facts.shape else ()
            return np.frombuffer(raw, facts.dtype).reshape(shape)
        except _DAMAGED as error:
            raise self._wrong(key, f"rows {start} to {stop - 1}: {error}") from error

    def attribute(self, key: str, name: str) -> Any:
        """None: arrays of npz have no attributes."""
        return None

    def _wrong(self, key: str, why: str) -> DataError:
        return DataError(f"{self.name}, {key}: cannot be read ({why}); download it again")
