"""Files of a data set: those that a pattern names, and text that may be damaged."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from io import StringIO
from pathlib import Path

from tactileforge.datasets.reading.order import Natural, name_keys, natural
from tactileforge.errors import ConfigError, DataError


class DamagedFileError(DataError):
    """A file that belongs to one touch is there, but cannot be read."""


def read_text(path: Path) -> str:
    """The text of a file, in UTF-8, without a byte order mark.

    Raises:
        DataError: It cannot be read, or is not UTF-8; names it.
    """
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            return file.read()
    except UnicodeDecodeError as error:
        raise DataError(
            f"{path}: byte {error.start} is not UTF-8; download it again, save it as CSV UTF-8, or "
            f"convert it: iconv -f latin1 -t utf-8 {path.name}"
        ) from error
    except OSError as error:
        raise DataError(f"{path}: cannot be read ({error.strerror}); download it again") from error


def read_rows(path: Path) -> list[list[str]]:
    """The cells of each line of a CSV without a header; [] for an empty line.

    Raises:
        DataError: It cannot be read, or is no CSV; names it.
    """
    try:
        return list(csv.reader(StringIO(read_text(path), newline="")))
    except csv.Error as error:
        raise DataError(f"{path}: not a CSV ({error}); download it again") from error


def matching_files(
    folder: Path, patterns: Sequence[str], layout: str
) -> tuple[list[Path], list[Path]]:
    """Files that match any pattern, each once, in natural order; and what matches and is none.

    Numbers in names count as such, 2 before 10 and 8.27 before 8.5; see `order.name_keys`.

    Args:
        folder: Where to look.
        patterns: As `Path.glob` takes them.
        layout: Name of the layout that has them, for messages.

    Raises:
        ConfigError: One is no pattern of paths below the folder.
    """
    found: dict[Path, bool] = {}  # whether a pattern that names files has matched it
    for pattern in patterns:
        is_for_files = "." in pattern.rpartition("/")[2]
        for path in _matches(folder, pattern, layout):
            found[path] = found.get(path, False) or is_for_files
    keys = name_keys(found)
    paths = sorted(found, key=lambda path: (*_folders(path.relative_to(folder)), *keys[path]))
    odd = [path for path in paths if not path.is_file() and (found[path] or not path.is_dir())]
    return [path for path in paths if path.is_file()], odd


def _matches(folder: Path, pattern: str, layout: str) -> list[Path]:
    try:
        return list(folder.glob(pattern))
    except (ValueError, NotImplementedError) as error:
        raise ConfigError(
            f"layout {layout!r}: pattern {pattern!r}: {error}; give a path from {folder} on, with "
            "** alone between slashes, e.g. *.png or **/*.png"
        ) from error


def kind_of(path: Path) -> str:
    """Content found where a file should be."""
    if path.is_symlink() and not path.exists():
        return "a link to nothing"
    return "a folder" if path.is_dir() else "a pipe, socket or device"


def _folders(path: Path) -> list[Natural]:
    """Key that sorts the folders of a path, name by name."""
    return [natural(part) for part in path.parts[:-1]]
