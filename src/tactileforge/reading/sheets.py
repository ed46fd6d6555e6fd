"""Tables of other programs: spreadsheets and npz here, others by packages.

A package reads tables by the ending of their files: `tactileforge.tables` in its entry points names
a function from the path of a file to place and cells of each row.
"""

from __future__ import annotations

import zipfile
from collections import Counter
from collections.abc import Callable, Mapping
from importlib import import_module
from itertools import islice, zip_longest
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactileforge.errors import DataError
from tactileforge.plugins import load
from tactileforge.reading.container import MOST_BYTES, check_unpacked
from tactileforge.reading.records import CELLS
from tactileforge.reading.text_tables import table_of
from tactileforge.util.regular import check_regular

#: Largest number of rows of a table.
_ROWS = 5_000_000


def read_sheet(path: Path) -> list[tuple[str, dict[str, str]]]:
    """Place and cells of each row of a table of another program; "" for a missing value.

    Raises:
        DataError: The file is damaged, holds objects of Python, or no table.
    """
    try:
        check_regular(path)
        read = _READERS.get(path.suffix.lower()) or load("tables", path.suffix.lower()[1:])
        return read(path)
    except DataError:
        raise
    except Exception as error:  # readers of other packages fail in their own ways
        line = " ".join(str(error).split())[:200]
        raise DataError(
            f"{path}: damaged, or no {path.suffix} ({line}); save it again, as CSV if need be"
        ) from error


def _spreadsheet(path: Path) -> list[tuple[str, dict[str, str]]]:
    _check_zip(path)
    book = import_module("openpyxl").load_workbook(path, read_only=True, data_only=True)
    try:
        tables = {}
        for sheet in book.worksheets:
            lines = [
                (i, [_text(cell) for cell in cells])
                for i, cells in enumerate(islice(sheet.iter_rows(values_only=True), _ROWS), 1)
            ]
            lines = [
                (i, cells[: max(n for n, cell in enumerate(cells, 1) if cell)])
                for i, cells in lines
                if any(cells)
            ]
            # a single cell is a remark
            if sum(len(cells) > 1 for _, cells in lines) > 1:
                tables[sheet.title] = lines
    finally:
        book.close()
    if len(tables) != 1:
        what = f"{len(tables)} sheets with tables ({', '.join(tables)})" if tables else "no table"
        raise DataError(f"{path}: {what}; save the one of the labels as CSV")
    ((title, lines),) = tables.items()
    table = table_of(lines, with_commas=True)
    return [
        (f"{path}, {title}, row {number}", dict(zip_longest(table.header, cells, fillvalue="")))
        for number, cells in table.rows
    ]


def _text(value: Any) -> str:
    if isinstance(value, bool | np.bool_):
        return str(int(value))
    return "" if value is None else str(value).strip()


def _npz(path: Path) -> list[tuple[str, dict[str, str]]]:
    _check_zip(path)
    with np.load(path, allow_pickle=False) as archive:
        return rows_of_arrays(path, {name: archive[name] for name in archive.files})


def rows_of_arrays(
    path: Path, arrays: Mapping[str, NDArray[Any]]
) -> list[tuple[str, dict[str, str]]]:
    """Place and cells of the rows of arrays.

    Arrays of as many rows as most have are columns, and single values are those of all rows.

    Args:
        path: File that they are from.
        arrays: Arrays by name; those of other shapes than (T,) and (T, k) are left out.

    Raises:
        DataError: There are none of numbers or texts.

    Example:
        >>> arrays = {"force": np.zeros((2, 2)), "t": np.arange(2), "who": np.array("me")}
        >>> _, row = rows_of_arrays(Path("a.npz"), arrays)[1]
        >>> row
        {'who': 'me', 'force.0': '0.0', 'force.1': '0.0', 't': '1'}
    """
    columns: dict[str, NDArray[Any]] = {}
    shared: dict[str, str] = {}
    for name, array in arrays.items():
        if array.dtype.kind not in "biufSU":
            continue
        if array.size == 1:
            shared[name] = _text(array.ravel()[0].item())
            continue
        if array.ndim == 2 and 1 in array.shape:  # a vector of MATLAB
            array = array.ravel()
        if array.ndim == 1:
            columns[name] = array
        elif array.ndim == 2 and array.shape[1] <= CELLS:
            columns |= {f"{name}.{i}": array[:, i] for i in range(array.shape[1])}
    lengths = Counter(len(column) for column in columns.values())
    if not lengths:
        if shared:
            return [(str(path), shared)]
        raise DataError(f"{path}: no columns of numbers or texts")
    # the most columns, and of as many the longer ones
    count = max(lengths, key=lambda length: (lengths[length], length))
    texts = {
        name: [_text(value) for value in column.tolist()]
        for name, column in columns.items()
        if len(column) == count
    }
    rows = zip(*texts.values(), strict=True)
    return [
        (f"{path}, row {i}", {**shared, **dict(zip(texts, row, strict=True))})
        for i, row in enumerate(rows)
    ]


def _check_zip(path: Path) -> None:
    with zipfile.ZipFile(path) as archive:
        sizes = [(one.compress_size, one.file_size) for one in archive.infolist()]
    packed, unpacked = (sum(column) for column in zip(*sizes, strict=True)) if sizes else (0, 0)
    if unpacked > MOST_BYTES or (why := check_unpacked(packed, unpacked)):
        words = why if unpacked <= MOST_BYTES else f"{unpacked >> 20} MB, more than any table"
        raise DataError(f"{path}: {words}")


_READERS: dict[str, Callable[[Path], list[tuple[str, dict[str, str]]]]] = {
    **dict.fromkeys((".xlsx", ".xlsm"), _spreadsheet),
    ".npz": _npz,
}
