"""Columns of parquet files, read as plain numbers and cells."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactileforge.errors import DataError, DataNotFoundError, unknown
from tactileforge.plugins import check_pointer

#: Errors raised while reading malformed tables of other programs.
WRONG = (KeyError, IndexError, TypeError, ValueError, AttributeError, OverflowError, RecursionError)
#: Row groups of large columns, columns, and headers of files kept in memory.
_GROUPS, _COLUMNS, _HEADERS = 8, 64, 4096


def import_arrow() -> ModuleType:
    """Imports pyarrow with ``parquet``; late, as it takes half a second and ``--help`` is fast."""
    import pyarrow.parquet

    module: ModuleType = pyarrow
    return module


def _damaged(path: Path, error: Exception) -> DataError:
    check_pointer(path)
    said = " ".join(str(error).split())[:300]
    return DataError(f"{path}: cannot be read ({said}); download it again")


@lru_cache(maxsize=_HEADERS)
def column_names(path: Path) -> tuple[str, ...]:
    """Names of the columns of a parquet file.

    Raises:
        DataNotFoundError: There is no such file.
        DataError: It cannot be read.
    """
    if not path.is_file():
        raise DataNotFoundError(f"{path}: not there; download the data set again")
    try:
        return tuple(import_arrow().parquet.read_schema(path).names)
    except (OSError, ValueError, import_arrow().lib.ArrowException) as error:
        raise _damaged(path, error) from error


def _check_columns(path: Path, columns: tuple[str, ...]) -> None:
    known = column_names(path)
    for name in columns:
        if name not in known:
            raise DataError(f"{path}: {unknown('column', name, known)}")


@lru_cache(maxsize=_COLUMNS)
def read_parquet(path: Path, columns: tuple[str, ...] | None = None) -> Any:
    """Reads some columns of a parquet file (None for all), and keeps the last ones in memory.

    Raises:
        DataNotFoundError: There is no such file.
        DataError: It cannot be read, or lacks a column; the message names the nearest.
    """
    _check_columns(path, columns or ())
    try:
        return import_arrow().parquet.read_table(
            path, columns=None if columns is None else list(columns)
        )
    except (*WRONG, OSError, import_arrow().lib.ArrowException) as error:
        raise _damaged(path, error) from error


@lru_cache(maxsize=_HEADERS)
def _group_starts(path: Path) -> NDArray[np.int64]:
    """First row of each row group of a parquet file, and the number of rows."""
    about = import_arrow().parquet.read_metadata(path)
    sizes = [about.row_group(i).num_rows for i in range(about.num_row_groups)]
    return np.cumsum([0, *sizes])


@lru_cache(maxsize=_GROUPS)
def _read_group(path: Path, column: str, number: int) -> Any:
    return import_arrow().parquet.ParquetFile(path).read_row_group(number, [column])[column]


def forget() -> None:
    """Forgets everything kept in memory, for changed files."""
    for kept in (column_names, read_parquet, _group_starts, _read_group):
        kept.cache_clear()


def read_cell(path: Path, column: str, row: int) -> Any:
    """Reads one cell of a large column; at most `_GROUPS` row groups stay in memory.

    Raises:
        DataError: The file cannot be read, or lacks the column.
    """
    _check_columns(path, (column,))
    try:
        return _cells(path, column, row, 1)[0].as_py()
    except (*WRONG, OSError, import_arrow().lib.ArrowException) as error:
        raise _damaged(path, error) from error


def read_rows(path: Path, column: str, row: int, count: int, dtype: str) -> NDArray[Any]:
    """Reads numbers of some rows of a large column; at most `_GROUPS` row groups stay in memory.

    Args:
        path: Path of the parquet file.
        column: Name of the column.
        row: First row.
        count: Number of rows, all of one row group or not.
        dtype: Type of the numbers.

    Returns:
        Array (rows, numbers of a row); see `numbers_of`.

    Raises:
        DataError: The file cannot be read, lacks the column, or has other cells there.
    """
    _check_columns(path, (column,))
    where = f"{path}: {column}"
    parts = []
    try:
        while count > 0:
            cells = _cells(path, column, row, count)
            parts.append(numbers_of(cells, dtype, where))
            row, count = row + len(cells), count - len(cells)
        return np.concatenate(parts)
    except (*WRONG, OSError, import_arrow().lib.ArrowException) as error:
        raise _damaged(path, error) from error


def _cells(path: Path, column: str, row: int, count: int) -> Any:
    """Cells from a row on, at most up to the end of its row group, one or more."""
    starts = _group_starts(path)
    number = int(np.searchsorted(starts, row, side="right")) - 1
    cells = _read_group(path, column, number).slice(row - int(starts[number]), count)
    if not len(cells):
        raise IndexError(f"no row {row}")
    return cells


def numbers_of(cells: Any, dtype: str, where: str) -> NDArray[Any]:
    """Converts cells of numbers, or of nested lists of one shape, to an array.

    Args:
        cells: Chunked array of pyarrow.
        dtype: Type of the numbers; a missing number becomes NaN, which only floats have.
        where: File and column, for messages.

    Returns:
        Array (rows, numbers of a row).

    Raises:
        DataError: The cells hold no numbers, lists of different lengths, or numbers too large for
            the type.
    """
    arrow = import_arrow()
    flat = cells.combine_chunks()
    try:
        while arrow.types.is_list(flat.type) or _is_other_list(arrow, flat.type):
            flat = _flattened(flat, where)
        kind = flat.type
        if not (
            arrow.types.is_integer(kind)
            or arrow.types.is_floating(kind)
            or arrow.types.is_boolean(kind)
        ):
            raise DataError(f"{where}: holds {kind}, no numbers; give another feature")
        if flat.null_count and not dtype.startswith("float"):
            raise DataError(f"{where}: {flat.null_count} cells without a value; download it again")
        if not arrow.types.is_floating(kind) or not dtype.startswith("float"):
            flat = flat.cast(arrow.type_for_alias(dtype))
        with np.errstate(over="ignore"):
            values = flat.to_numpy(zero_copy_only=False).astype(np.dtype(dtype))
    except arrow.lib.ArrowException as error:
        said = " ".join(str(error).split())[:200]
        raise DataError(f"{where}: no {dtype} ({said}); download it again") from error
    rows: NDArray[Any] = values.reshape(len(cells), -1)
    return rows


def _is_other_list(arrow: ModuleType, kind: Any) -> bool:
    return bool(arrow.types.is_large_list(kind) or arrow.types.is_fixed_size_list(kind))


def _flattened(lists: Any, where: str) -> Any:
    """Joins lists of one length.

    Raises:
        DataError: Their lengths differ, or one is missing.
    """
    import pyarrow.compute as compute

    lengths = compute.min_max(compute.list_value_length(lists)).as_py()
    if lists.null_count or lengths["min"] != lengths["max"]:
        raise DataError(
            f"{where}: lists of {lengths['min']} to {lengths['max']} numbers"
            f"{', and cells without one' if lists.null_count else ''}, where a feature has one "
            "shape; download it again"
        )
    return lists.flatten()
