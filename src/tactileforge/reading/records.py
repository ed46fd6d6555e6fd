"""Rows of files other than CSV: JSON, JSON lines, YAML and arrays of NumPy; and of many at once.

Values within others are named by a point: ``{"force": {"z": 2}}`` has the column ``force.z``, and
``{"force": [0, 0, 2]}`` the columns ``force.0`` to ``force.2``.
"""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterator, Mapping, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from tactileforge.data.frames.stacks import StackFrames, load_array
from tactileforge.errors import DataError
from tactileforge.plugins import names
from tactileforge.reading.files import read_text
from tactileforge.reading.order import name_keys
from tactileforge.util.regular import check_regular
from tactileforge.util.untrusted import load_json, load_yaml

#: Endings of tables that are read here.
RECORDS = frozenset({".json", ".jsonl", ".ndjson", ".yaml", ".yml", ".npy"})
#: Packages that read tables of other programs, by the endings of these.
_NEEDED = {".xlsx": "openpyxl", ".xlsm": "openpyxl", ".mat": "scipy"}
#: Column of the name of the file that a row is from, where there is one per row.
FILE_COLUMN = "file"
#: Columns of equal length from which these are rows; a shorter list is a vector, such as a wrench.
_ROWS = 8
#: Largest number of values in one row: what has more is not a row of labels.
CELLS = 200

_PANDAS = "python -c \"import pandas; pandas.{}('{}').to_csv('{}', index=False)\""
_OFFICE = "libreoffice --headless --convert-to csv {}"
_MAT = (
    "python -c \"import numpy, scipy.io; numpy.savez('{1}', **{{k: v for k, v in "
    "scipy.io.loadmat('{0}').items() if k[0] != '_'}})\""
)
#: MATLAB's arrays lie in HDF5 with their axes turned round.
_MAT_73 = (
    "python -c \"import h5py, numpy; numpy.savez('{1}', **{{k: numpy.transpose(v) for k, v in "
    "h5py.File('{0}').items() if hasattr(v, 'shape')}})\""
)

_HDF5 = (
    "python -c \"import h5py, numpy; numpy.savez('{1}', **{{k: v[()] for k, v in "
    "h5py.File('{0}').items() if hasattr(v, 'shape')}})\""
)
_TORCH = (
    "python -c \"import numpy, torch; numpy.savez('{1}', **torch.load('{0}', weights_only=True))\""
)
_TDMS = (
    'pip install nptdms pandas && python -c "from nptdms import TdmsFile; '
    "TdmsFile('{}').as_dataframe().to_csv('{}', index=False)\""
)
_LMDB = (
    "python -c \"import lmdb; [open(k.decode().replace('/', '_'), 'wb').write(v) for k, v in "
    "lmdb.open('{}', readonly=True).begin().cursor()]\""
)


def sheets() -> frozenset[str]:
    """Endings of tables of other programs that are read: those of the core and of packages."""
    return frozenset((".xlsx", ".xlsm", ".npz", *(f".{name}" for name in names("tables"))))


def conversion(path: Path) -> str:
    """Kind of an unread file of labels, and a way to convert or unpack it; "" for another.

    Example:
        >>> conversion(Path("forces.xls"))
        'a spreadsheet: libreoffice --headless --convert-to csv forces.xls'
    """
    name, ending = shlex.quote(path.name), path.suffix.lower()
    is_hdf5 = ending == ".mat" and _starts_with(path, b"MATLAB 7.3")
    needed = "" if is_hdf5 else _NEEDED.get(ending, "")
    is_missing = bool(needed) and find_spec(needed) is None
    if ending in sheets() and not is_missing:
        return ""
    csv, npz = f"{path.stem}.csv", f"{path.stem}.npz"
    install = f" (or pip install {needed}: it is read as it is)" if is_missing else ""
    match ending:
        case ".xlsx" | ".xlsm" | ".xls" | ".ods":
            return f"a spreadsheet: {_OFFICE.format(name)}{install}"
        case ".mat":
            told = "MATLAB 7.3, an HDF5" if is_hdf5 else "MATLAB"
            how = (_MAT_73 if is_hdf5 else _MAT).format(path.name, npz)
            return f"{told}: {how}{install}"
        case ".parquet" | ".feather":
            how = _PANDAS.format(f"read_{ending[1:]}", path.name, csv)
            return f"a {ending[1:]}: {how}{install}"
        case ".pkl" | ".pickle":
            return "a pickle, which runs code when it is read: save it as CSV or npz"
        case ".h5" | ".hdf5":
            return f"an HDF5: {_HDF5.format(path.name, npz)}"
        case ".pt" | ".pth":
            return f"PyTorch's; a dictionary of tensors: {_TORCH.format(path.name, npz)}"
        case ".lvm":
            told = "a table of LabVIEW: awk 'n > 1; /End_of_Header/ {n++}'"
            return f"{told} {name} > {shlex.quote(f'{path.stem}.tsv')}"
        case ".tdms":
            return f"LabVIEW's: {_TDMS.format(path.name, csv)}"
        case ".mdb" if path.stem == "data":
            return f"an LMDB: {_LMDB.format(path.parent.name)}"
    if ".tfrecord" in path.name.lower():
        return "records of TensorFlow: write pictures as PNG, and values as CSV, with its reader"
    return _unpacking(path)


def _unpacking(path: Path) -> str:
    """Kind of an archive, and the command for its files; "" for another file."""
    name, (stem, _, ending) = shlex.quote(path.name), path.name.partition(".")
    folder = shlex.quote(stem)
    match ending.lower():
        case "zip":
            return f"an archive: unzip {name} -d {folder}"
        case "7z":
            return f"an archive: 7z x {name} -o{folder}"
        case "rar":
            return f"an archive: unrar x {name} {folder}/"
        case "tar" | "tgz" | "tar.gz" | "tar.bz2" | "tar.xz" | "tar.zst":
            return f"an archive: mkdir -p {folder} && tar -xf {name} -C {folder}"
        case other if other.endswith(".gz"):
            return f"compressed: gunzip {name}"
    return ""


#: Most characters of a name or a cell of a table in JSON.
_MOST_CELL = 1 << 19
_LONG = re.compile(rf'"[^"\\]{{{_MOST_CELL}}}')


def _starts_with(path: Path, start: bytes) -> bool:
    try:
        check_regular(path)
        with path.open("rb") as file:
            return file.read(len(start)) == start
    except OSError:
        return False


def stack_fault(path: Path) -> str:
    """Reason why an array of pictures is not read; "" for a table of numbers and other files."""
    if path.suffix.lower() != ".npy":
        return ""
    try:
        if load_array(path).ndim > 2:
            StackFrames(path)
    except DataError as error:
        return str(error)
    return ""


def read_records(path: Path) -> list[tuple[str, dict[str, str]]]:
    """Place and cells of each row of a JSON, JSON lines, YAML or .npy; "" for a missing value.

    A JSON or YAML is a list of rows; one row; rows by the name of their file (column ``file``); a
    list of rows among values that all share; columns, lists of one length of 8 or more, of which
    mappings may hold some; or 8 or more numbers, or lists of as many numbers each. A row of
    numbers, or of an array, has the columns ``0``, ``1`` and so on.

    Raises:
        DataError: The file is damaged, or has no rows.
    """
    if path.suffix.lower() == ".npy":
        return _array_rows(path)
    if path.suffix.lower() in (".jsonl", ".ndjson"):
        lines = read_text(path).splitlines()
        return _filled(
            [
                (f"{path}, row {number}", _cells(_parsed(path, line, number), path))
                for number, line in enumerate(lines, 1)
                if line.strip()
            ]
        )
    content = _parsed(path, read_text(path))
    rows = _rows_of_coco(content) or _rows_of(content)
    is_one = len(rows) == 1
    places = [
        str(path) if is_one else f"{path}, row {number}" for number in range(1, len(rows) + 1)
    ]
    return _filled([(where, _cells(row, path)) for where, row in zip(places, rows, strict=True)])


def read_many(pattern: Path) -> list[tuple[str, dict[str, str]]]:
    """Place and cells of the rows of all files of a pattern (``mug/*.json``), in order.

    Each row has the file's name without its ending in the column ``file``, unless it has one.

    Raises:
        DataError: A file is damaged, or no row of a table.
    """
    rows = []
    keys = name_keys(pattern.parent.glob(pattern.name))
    for path in sorted(keys, key=lambda path: keys[path]):
        for where, cells in read_records(path):
            rows.append((where, {FILE_COLUMN: path.stem} | cells))
    return _filled(rows)


def _parsed(path: Path, text: str, line: int = 0) -> Any:
    if len(text) > _MOST_CELL and _LONG.search(text):
        raise DataError(f"{path}: a name or text of more than {_MOST_CELL} characters")
    is_yaml = path.suffix.lower() in (".yaml", ".yml")
    try:
        return load_yaml(text) if is_yaml else load_json(text)
    except ValueError as error:
        where = f"{path}, row {line}" if line else str(path)
        raise DataError(
            f"{where}: not {'YAML' if is_yaml else 'JSON'} ({error}); correct it"
        ) from error


def _rows_of(content: Any) -> list[Any]:
    """Rows of the content of a file; see `read_records`."""
    if isinstance(content, list) and len(content) >= _ROWS:
        rows = content if all(isinstance(row, list) for row in content) else [[x] for x in content]
        width = len(rows[0])
        if (
            width <= CELLS
            and {*map(len, rows)} == {width}
            and all(_is_number(x) for row in rows for x in row)
        ):
            return [{str(i): x for i, x in enumerate(row)} for row in rows]
    if not isinstance(content, Mapping):
        return list(content) if isinstance(content, list) else [content]
    values = list(content.values())
    if len(values) > 1 and _are_rows(values):
        if all(value.keys() == values[0].keys() for value in values[1:]):
            return [{FILE_COLUMN: str(name), **value} for name, value in content.items()]
        return [content]
    lists = {name: value for name, value in content.items() if isinstance(value, list)}
    tables = [name for name, rows in lists.items() if rows and _are_rows(rows)]
    if len(tables) == 1:
        shared = {name: value for name, value in content.items() if name != tables[0]}
        return [{**shared, **row} for row in lists[tables[0]]]
    lengths = {len(value) for value in lists.values()}
    if len(lengths) == 1 and min(lengths) >= _ROWS:
        shared = {name: value for name, value in content.items() if name not in lists}
        lists |= _inner_lists(shared, min(lengths))
        columns = zip(*lists.values(), strict=True)
        return [{**shared, **dict(zip(lists, row, strict=True))} for row in columns]
    return [content]


def _inner_lists(values: dict[str, Any], length: int) -> dict[str, list[Any]]:
    """Lists of a length within mappings, such as ``ft.force``; these are taken out of values."""
    found: dict[str, list[Any]] = {}
    for name, inner in [*values.items()]:
        if isinstance(inner, Mapping):
            own = {k: v for k, v in inner.items() if isinstance(v, list) and len(v) == length}
            values[name] = {key: value for key, value in inner.items() if key not in own}
            found |= {f"{name}.{key}": value for key, value in own.items()}
    return found


def _rows_of_coco(content: Any) -> list[Any]:
    """File and category of each image in COCO's form; of its files, where some have several.

    [] for another form.
    """
    keys = ("images", "annotations", "categories")
    parts: list[Any] = [None]
    if isinstance(content, Mapping):
        parts = [content.get(key) for key in keys]
    if not all(isinstance(part, list) and part and _are_rows(part) for part in parts):
        return []
    images, annotations, categories = parts
    try:
        names = {one["id"]: one["name"] for one in categories}
        told = {one["image_id"]: names[one["category_id"]] for one in annotations}
        files = {one["id"]: one["file_name"] for one in images}
    except (KeyError, TypeError):
        return []
    if len(told) < len(annotations):
        return [{"file_name": name} for name in files.values()]
    return [
        {"file_name": name, "category": told[number]}
        for number, name in files.items()
        if number in told
    ]


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _are_rows(rows: Sequence[Any]) -> bool:
    return all(isinstance(row, Mapping) for row in rows)


def _cells(row: Any, path: Path) -> dict[str, str]:
    if not isinstance(row, Mapping):
        raise DataError(
            f"{path}: {type(row).__name__} where a row of named values is wanted; write it as "
            '{"force": [0, 0, 2], "object": "mug"}'
        )
    return dict(flat(row, ""))


def flat(value: Any, name: str) -> Iterator[tuple[str, str]]:
    """Names and texts of a value and those within; lists beyond the limit are left out.

    Args:
        value: Mappings, lists and plain values, within each other.
        name: Name of the value; "" for the top.
    """
    if isinstance(value, Mapping | list) and len(value) <= CELLS:
        inner = value.items() if isinstance(value, Mapping) else enumerate(value)
        for key, one in inner:
            yield from flat(one, f"{name}.{key}" if name else str(key))
    elif isinstance(value, bool):
        yield name, str(int(value))
    elif value is None:
        yield name, ""
    elif isinstance(value, str | int | float):
        yield name, str(value).strip()


def _filled(rows: list[tuple[str, dict[str, str]]]) -> list[tuple[str, dict[str, str]]]:
    """Rows with all columns, in the order of their first rows."""
    header = dict.fromkeys((name for _, cells in rows for name in cells), "")
    return [(where, header | cells) for where, cells in rows]


def _array_rows(path: Path) -> list[tuple[str, dict[str, str]]]:
    array = load_array(path)
    if array.dtype.names:
        names = [name for name in array.dtype.names if array.dtype[name].kind in "biufUS"]
        columns = [array[name].astype(str) for name in names]
    elif array.ndim in (1, 2) and array.dtype.kind in "biuf":
        table = np.asarray(array).reshape(len(array), -1)
        if table.shape[1] > CELLS:
            raise DataError(f"{path}: {table.shape[1]} columns, where a table has few")
        names, columns = [str(i) for i in range(table.shape[1])], list(table.T)
    else:
        raise DataError(
            f"{path}: an array of {array.dtype} {array.shape}, where a table has rows and columns "
            "of numbers"
        )
    texts = [[str(value) for value in column.tolist()] for column in columns]
    rows = zip(*texts, strict=True)
    return [(f"{path}, row {i}", dict(zip(names, row, strict=True))) for i, row in enumerate(rows)]
