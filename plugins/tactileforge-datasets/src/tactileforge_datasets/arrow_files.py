"""Tables in parquet, arrow and feather: headers, plain rows and single cells."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any

from tactileforge.errors import DataError
from tactileforge.plugins import check_pointer
from tactileforge.reading import check_regular
from tactileforge_datasets import parquet
from tactileforge_datasets.parquet_tables import has_bytes

#: Endings of tables; arrow is what ``save_to_disk`` of Hugging Face writes.
ENDINGS = (".parquet", ".arrow")
#: Tables that stay open in a process.
_OPEN = 8


def read_schema(path: Path) -> Any:
    """The schema of a table.

    Raises:
        DataError: The file is damaged.
    """
    if path.suffix == ".arrow":
        return _arrow(str(path), os.getpid()).schema
    import pyarrow as arrow
    from pyarrow import parquet as files

    try:
        check_regular(path)
        return files.read_schema(path)
    except (OSError, ValueError, arrow.ArrowException) as error:
        raise _damaged(path, error) from error


def image_columns(schema: Any) -> list[str]:
    """Columns of images: bytes, or structs with bytes."""
    return [field.name for field in schema if has_bytes(field.type)]


def class_names(schema: Any) -> dict[str, list[str]]:
    """Names of the classes of columns of whole numbers, as Hugging Face keeps them."""
    try:
        about = json.loads((schema.metadata or {})[b"huggingface"])["info"]["features"]
        return {
            name: [str(one) for one in feature["names"]]
            for name, feature in about.items()
            if isinstance(feature, Mapping) and feature.get("_type") == "ClassLabel"
        }
    except (KeyError, TypeError, ValueError):
        return {}


def read_plain(path: Path, columns: Sequence[str]) -> Iterator[dict[str, Any]]:
    """Yields the rows of some columns as plain values.

    Raises:
        DataError: The file is damaged.
    """
    if path.suffix == ".arrow":
        for batch in _arrow(str(path), os.getpid()).select(columns).to_batches():
            yield from batch.to_pylist()
    else:
        yield from parquet.read_rows(path, columns)


def read_image(path: str, column: str, row: int) -> bytes:
    """The bytes of an image in a cell.

    Raises:
        DataError: The file is damaged, or has no image there.
    """
    if path.endswith(".arrow"):
        table = _arrow(path, os.getpid())
        cell = table[column][row].as_py() if row < table.num_rows else None
    else:
        cell = parquet.read_cell(path, column, row)
    return parquet.image_bytes(cell, f"{path}, {column}, row {row}")


@lru_cache(maxsize=_OPEN)
def _arrow(path: str, process: int) -> Any:
    """A table of arrow, mapped into memory; in each process anew."""
    import pyarrow as arrow

    try:
        check_regular(path)
        file = arrow.memory_map(path)
        try:
            return arrow.ipc.open_stream(file).read_all()
        except arrow.ArrowInvalid:
            file.seek(0)
            return arrow.ipc.open_file(file).read_all()
    except (OSError, ValueError, arrow.ArrowException) as error:
        raise _damaged(path, error) from error


def _damaged(path: str | Path, error: BaseException) -> DataError:
    check_pointer(path)
    kind = Path(path).suffix[1:]
    return DataError(f"{path}: no {kind} file, or damaged ({error}); download it again")
