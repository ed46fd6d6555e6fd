"""Arrays of npz files, alone or in an archive; pickled ones are refused."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from tactileforge.errors import DataError
from tactileforge_episodes.arrays import Container, Facts, is_sane
from tactileforge_episodes.members import DAMAGED, stored_part
from tactileforge_episodes.slices import Slice

#: Readers of the header of an npy file, by its version.
_HEADERS: dict[tuple[int, int], Callable[..., Any]] = {
    (1, 0): npy.read_array_header_1_0,
    (2, 0): npy.read_array_header_2_0,
}


@dataclass(frozen=True)
class _Entry:
    """Place of an array.

    Attributes:
        values: Bytes of its values in the file; None where it is compressed.
        fortran: Whether its first axis changes fastest.
    """

    values: Slice | None
    fortran: bool


class NpzFile(Container):
    """Arrays of an npz file; rows of uncompressed ones are read alone.

    Args:
        name: Path of the file, for messages.
        file: The open file.

    Raises:
        DataError: It is no npz file.
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

    def keys(self) -> list[str]:
        """Names of the arrays, in order."""
        return sorted(self._names)

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
        is_stored = entry.compress_type == zipfile.ZIP_STORED
        values = stored_part(self._file, entry).part(header, size) if is_stored else None
        self._entries[key] = _Entry(values, fortran)
        lazy = is_stored and not (fortran and len(shape) > 1)
        return Facts(tuple(shape), dtype, 1 if lazy else max(1, shape[0] if shape else 1))

    def _rows(self, key: str, facts: Facts, start: int, stop: int) -> NDArray[Any]:
        entry = self._entries[key]
        if entry.values is None or entry.fortran:
            with self._archive.open(self._names[key]) as member:
                content = io.BytesIO(member.read())
            values = npy.read_array(content, allow_pickle=False)
            return np.asarray(values[start:stop] if facts.shape else values)
        row = facts.dtype.itemsize * int(np.prod(facts.shape[1:], dtype=np.int64))
        count = min(stop, facts.rows) - start
        raw = entry.values.part(start * row, count * row).read()
        return np.frombuffer(raw, facts.dtype).reshape(
            (count, *facts.shape[1:])[: len(facts.shape)]
        )
