"""Images in a column of a parquet file."""

from __future__ import annotations

from pathlib import Path

from tactileforge.errors import DataError
from tactileforge.reading import read_regular
from tactileforge_lerobot.folder import inside
from tactileforge_lerobot.parquet import read_cell

#: Largest file of a picture, bytes.
_MOST = 1 << 28


def read_image(root: Path, path: Path, feature: str, start: int, i: int) -> bytes:
    """Bytes of the encoded image of a row, or of the file named by its cell.

    Args:
        root: Folder of the data set.
        path: Path of the parquet file.
        feature: Name of the column.
        start: First row of the episode.
        i: Number of the row in the episode.

    Raises:
        DataError: The cell holds neither, or the named file cannot be read.
    """
    cell = read_cell(path, feature, start + i)
    content, name = (cell.get("bytes"), cell.get("path")) if isinstance(cell, dict) else (cell, "")
    if isinstance(content, bytes):
        return content
    where = f"{path}, row {start + i}, {feature}"
    if not isinstance(name, str) or not name:
        raise DataError(f"{where}: neither bytes nor the path of an image")
    try:
        return read_regular(inside(root, name, where), _MOST)
    except OSError as error:
        raise DataError(f"{where}: {name} cannot be read ({error.strerror})") from error
