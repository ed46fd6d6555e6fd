"""Files of a data set: those that a pattern names, and text that may be damaged."""

from __future__ import annotations

import csv
import re
from io import StringIO
from pathlib import Path

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


def matching_files(folder: Path, pattern: str, layout: str) -> tuple[list[Path], list[Path]]:
    """Files that match, in natural order: 2 before 10; and what matches and is none.

    Args:
        folder: Where to look.
        pattern: As `Path.glob` takes it.
        layout: Name of the layout that has it, for messages.

    Raises:
        ConfigError: It is no pattern of paths below the folder.
    """
    try:
        found = list(folder.glob(pattern))
    except (ValueError, NotImplementedError) as error:
        raise ConfigError(
            f"layout {layout!r}: pattern {pattern!r}: {error}; give a path from {folder} on, with "
            "** alone between slashes, e.g. *.png or **/*.png"
        ) from error
    paths = sorted(found, key=lambda path: _natural(path.relative_to(folder)))
    is_for_files = "." in pattern.rpartition("/")[2]
    odd = [path for path in paths if not path.is_file() and (is_for_files or not path.is_dir())]
    return [path for path in paths if path.is_file()], odd


def kind_of(path: Path) -> str:
    """Content found where a file should be."""
    if path.is_symlink() and not path.exists():
        return "a link to nothing"
    return "a folder" if path.is_dir() else "a pipe, socket or device"


def _natural(path: Path) -> list[list[tuple[str, int]]]:
    return [
        [(text, int(digits or 0)) for text, digits in re.findall(r"(\D*)(\d*)", part)]
        for part in path.parts
    ]
