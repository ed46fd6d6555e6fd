"""Lists of the recordings of each split: ``train.txt`` and ``test.txt``, ``train.csv`` ..."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from tactileforge.errors import TactileForgeError
from tactileforge.reading.guessing.view_words import words_of
from tactileforge.reading.records import RECORDS, sheets
from tactileforge.reading.splits import SPLIT_OF_FOLDER
from tactileforge.reading.tables import read_cells
from tactileforge.reading.written_names import by_ends

_ENDINGS = frozenset({".csv", ".tsv", ".txt"}) | RECORDS - {".npy"}
#: Smallest share of the cells of a column that name files, and of the files that lists name.
_ABOUT, _MOST = 0.8, 0.5


def lists_of_splits(
    files: Sequence[Path], media: Sequence[Path], root: Path
) -> dict[str, tuple[Path, list[Path]]]:
    """The list and the files of each split; {} without lists of two splits or more."""
    tables: dict[tuple[Path, str], dict[str, Path]] = {}
    for path in files:
        words = [word for word in words_of(path.stem) if word in SPLIT_OF_FOLDER]
        if len(words) == 1 and path.suffix.lower() in _ENDINGS | sheets():
            rest = path.name.lower().replace(words[0], "", 1)
            tables.setdefault((path.parent, rest), {})[words[0]] = path
    several = [own for own in tables.values() if len({*map(SPLIT_OF_FOLDER.get, own)}) > 1]
    if len(several) != 1:
        return {}
    folders: dict[str, list[Path]] = {}
    for path in media:
        name = path.relative_to(root).as_posix()
        folders[name] = folders[name.removesuffix(path.suffix)] = [path]
        for above in path.relative_to(root).parents[:-1]:
            folders.setdefault(above.as_posix(), []).append(path)
    named = by_ends((name, tuple(paths)) for name, paths in folders.items())
    found = {word: (path, _listed(path, named)) for word, path in several[0].items()}
    own = [path for _, paths in found.values() for path in paths]
    is_whole = all(paths for _, paths in found.values()) and len({*own}) == len(own)
    return found if is_whole and len(own) >= _MOST * len(media) else {}


def _listed(path: Path, named: dict[str, tuple[Path, ...] | None]) -> list[Path]:
    """Files named by most cells of a column of a table; [] for another table."""
    try:
        rows = [cells for _, cells in read_cells(path, [])]
    except TactileForgeError:
        return []
    for title in rows[0] if rows else ():
        cells = [row[title].replace("\\", "/").removeprefix("./").rstrip("/") for row in rows]
        told = [named.get(cell) for cell in cells]
        if sum(map(bool, told)) >= _ABOUT * len(cells):
            return [*dict.fromkeys(path for paths in told if paths for path in paths)]
    return []
