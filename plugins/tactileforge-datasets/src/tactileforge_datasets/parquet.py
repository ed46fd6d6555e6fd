"""Rows and cells of parquet files; a cell is read without the file around it."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from functools import lru_cache
from pathlib import Path
from threading import Lock
from typing import Any

import numpy as np

from tactileforge.errors import DataError, unknown
from tactileforge.plugins import check_pointer
from tactileforge.reading import check_regular

#: Files that stay open in a process.
_OPEN = 4


def read_rows(path: Path, columns: Sequence[str], at_once: int = 1024) -> Iterator[dict[str, Any]]:
    """Yields the rows of some columns as plain values; a dotted name is a field of a struct.

    A part of a struct and a column with a dot in its name are the same here.

    Args:
        path: Path of the file.
        columns: Names of the columns; missing ones are left out of the rows.
        at_once: Rows in memory at once.

    Raises:
        DataError: The file is damaged.
    """
    import pyarrow as arrow

    try:
        file = _open(path)
        wanted = [name for name in columns if name in column_names(path)]
        for batch in file.iter_batches(at_once, columns=wanted, use_threads=False):
            for row in batch.to_pylist():
                yield {name: _field(row, name) for name in wanted}
    except (OSError, ValueError, arrow.ArrowException) as error:
        raise _damaged(path, error) from error


def column_names(path: Path) -> list[str]:
    """Names of the columns, and of the fields of structs with a dot.

    Raises:
        DataError: The file is damaged.
    """
    import pyarrow as arrow

    try:
        schema = _open(path).schema_arrow
    except (OSError, ValueError, arrow.ArrowException) as error:
        raise _damaged(path, error) from error
    names = []
    for field in schema:
        names.append(field.name)
        if arrow.types.is_struct(field.type):
            names += [f"{field.name}.{inner.name}" for inner in field.type]
    return names


def check_columns(path: Path, needed: Sequence[str]) -> None:
    """Checks the columns of a file.

    Raises:
        DataError: A column is missing; names the nearest one.
    """
    known = column_names(path)
    for name in needed:
        if name not in known:
            raise DataError(f"{path}: {unknown('column', name, known, 'Download it again')}")


def read_cell(path: str, column: str, row: int) -> Any:
    """A cell as plain values; the next rows cost little, as the file is read in steps.

    Args:
        path: Path of the file.
        column: Name of the column.
        row: Number of the row.

    Raises:
        DataError: The file is damaged.
    """
    import pyarrow as arrow

    try:
        return _cursor(path, column, os.getpid()).cell(row)
    except (IndexError, OSError, StopIteration, ValueError, arrow.ArrowException) as error:
        raise _damaged(path, error) from error


def image_bytes(cell: Any, where: str) -> bytes:
    """Bytes of an image or video in a cell: bytes, or a struct with ``bytes``.

    Raises:
        DataError: There are none.
    """
    content = cell.get("bytes") if isinstance(cell, dict) else cell
    if not isinstance(content, bytes) or not content:
        raise DataError(f"{where}: no bytes of a picture; download it again")
    return content


class _Cursor:
    """A column of large cells, read forward a few rows at a time."""

    def __init__(self, path: str, column: str) -> None:
        self.file, self.column = _open(Path(path)), column
        counts = [self.file.metadata.row_group(i).num_rows for i in range(self.file.num_row_groups)]
        self.starts = np.cumsum([0, *counts])
        self.batches: Iterator[Any] = iter(())
        self.rows: Any = []
        self.first = self.group = self.last = -1
        self.value: Any = None
        self.lock = Lock()

    def cell(self, row: int) -> Any:
        with self.lock:
            if row == self.last:
                return self.value
            group = int(np.searchsorted(self.starts, row, side="right")) - 1
            if row < self.first or group != self.group:
                self.batches = self.file.iter_batches(
                    4, row_groups=[group], columns=[self.column], use_threads=False
                )
                self.first, self.rows, self.group = int(self.starts[group]), [], group
            while row >= self.first + len(self.rows):
                self.first += len(self.rows)
                self.rows = next(self.batches).column(0)
            self.value, self.last = self.rows[row - self.first].as_py(), row
            return self.value


@lru_cache(maxsize=_OPEN)
def _cursor(path: str, column: str, process: int) -> _Cursor:
    """A cursor of this process; one of a forked parent is not shared."""
    return _Cursor(path, column)


def _open(path: Path) -> Any:
    from pyarrow import parquet

    check_regular(path)
    return parquet.ParquetFile(path)


def _field(row: dict[str, Any], name: str) -> Any:
    if name in row:
        return row[name]
    outer, _, inner = name.partition(".")
    struct = row.get(outer)
    return struct.get(inner) if isinstance(struct, dict) else None


def _damaged(path: str | Path, error: BaseException) -> DataError:
    check_pointer(path)
    return DataError(f"{path}: no parquet file, or damaged ({error}); download it again")
