"""Tables of labels in parquet and feather."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from tactileforge.errors import DataError
from tactileforge.reading import flat

#: Largest number of rows of a table of labels.
_ROWS = 5_000_000


def read_arrow_table(path: Path) -> list[tuple[str, dict[str, str]]]:
    """Place and cells of the rows of a parquet or feather; columns of bytes are left out.

    Args:
        path: Path of the file.

    Raises:
        DataError: It has more rows than a table of labels.
    """
    from pyarrow import feather, parquet

    is_parquet = path.suffix.lower() == ".parquet"
    table = parquet.ParquetFile(path) if is_parquet else feather.read_table(path, memory_map=True)
    schema = table.schema_arrow if is_parquet else table.schema
    count = table.metadata.num_rows if is_parquet else table.num_rows
    if count > _ROWS:
        raise DataError(f"{path}: {count:,} rows, where {_ROWS:,} are the limit of a table")
    names = [field.name for field in schema if not has_bytes(field.type)]
    rows = (table.read(columns=names) if is_parquet else table.select(names)).to_pylist()
    return [(f"{path}, row {i}", dict(flat(row, ""))) for i, row in enumerate(rows)]


def has_bytes(kind: Any) -> bool:
    """Whether values of a type are bytes, or hold some, as pictures do."""
    from pyarrow import types

    if types.is_struct(kind):
        return any(has_bytes(field.type) for field in kind)
    return bool(types.is_binary(kind) or types.is_large_binary(kind))
