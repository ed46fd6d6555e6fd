"""Images in a column of a parquet file."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, overload

from tactileforge.plugin import DataError
from tactileforge_lerobot.folder import inside
from tactileforge_lerobot.parquet import read_cell


class ColumnImages(Sequence[bytes]):
    """Encoded images of some rows, read on demand.

    A cell holds the bytes of an image file, or the path of one inside the data set.

    Args:
        root: Folder of the data set.
        path: Path of the parquet file.
        feature: Name of the column.
        start: First row.
        length: Number of rows.
    """

    def __init__(self, root: Path, path: Path, feature: str, start: int, length: int) -> None:
        self.root, self.path, self.feature = root, path, feature
        self.start, self.length = start, length

    def __len__(self) -> int:
        return self.length

    def __iter__(self) -> Iterator[bytes]:
        return (self[i] for i in range(self.length))

    @overload
    def __getitem__(self, i: int) -> bytes: ...
    @overload
    def __getitem__(self, i: slice) -> list[bytes]: ...
    def __getitem__(self, i: int | slice) -> bytes | list[bytes]:
        if isinstance(i, slice):
            return [self[j] for j in range(*i.indices(self.length))]
        cell = read_cell(self.path, self.feature, self.start + i)
        content = cell.get("bytes") if isinstance(cell, dict) else cell
        if isinstance(content, bytes):
            return content
        return self._file(cell.get("path") if isinstance(cell, dict) else None, self.start + i)

    def _file(self, name: Any, row: int) -> bytes:
        where = f"{self.path}, row {row}, {self.feature}"
        if not isinstance(name, str) or not name:
            raise DataError(f"{where}: neither bytes nor the path of an image")
        try:
            return inside(self.root, name, where).read_bytes()
        except OSError as error:
            raise DataError(f"{where}: {name} cannot be read ({error.strerror})") from error
