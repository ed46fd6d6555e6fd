"""Files of a data set: matching by pattern, and reading of text and CSV."""

from __future__ import annotations

import codecs
import csv
import os
import re
import shlex
from collections.abc import Callable, Sequence
from functools import cache
from io import StringIO
from pathlib import Path
from typing import Any

from tactileforge.data.frames.companions import without_companions
from tactileforge.errors import ConfigError, DataError
from tactileforge.reading.linked import matches
from tactileforge.reading.order import name_keys, natural
from tactileforge.util.regular import MOST_WHOLE, read_regular, regular_text
from tactileforge.util.untrusted import load_yaml

#: Byte order marks of UTF-32 and UTF-16. UTF-32 first: the mark of UTF-16 LE begins UTF-32 LE's.
_MARKS = {
    codecs.BOM_UTF32_LE: "utf-32",
    codecs.BOM_UTF32_BE: "utf-32",
    codecs.BOM_UTF16_LE: "utf-16",
    codecs.BOM_UTF16_BE: "utf-16",
}


#: Most characters of a line of a table.
_MOST_LINE = 1 << 19
#: Words in signs of East Asia, with a letter of a Latin word before or behind them.
_ASIAN = re.compile("([a-z]?)[^\x00-\x7f]+([a-z]?)")
#: Longer spellings of endings.
_ENDINGS = {".jpeg": ".jpg", ".tiff": ".tif"}


class DamagedFileError(DataError):
    """Unusable existing file of a single touch, to be skipped; others are read."""


def read_text(path: Path) -> str:
    """The text of a file, in UTF-8, without a byte order mark.

    Raises:
        DataError: The file cannot be read, or is not UTF-8; names it and its likely encoding.
    """
    try:
        raw = read_regular(path, MOST_WHOLE)
        encoding = wide_encoding(raw)
        if encoding is None:
            return raw.decode("utf-8-sig")
        raise DataError(
            f"{path}: byte 0 is not UTF-8: it is {encoding.upper()}; save it as CSV UTF-8, or "
            f"convert it: iconv -f {encoding} -t utf-8 {shlex.quote(path.name)} > utf8.csv"
        )
    except UnicodeDecodeError as error:
        raise DataError(
            f"{path}: byte {error.start} is not UTF-8; download it again, save it as CSV UTF-8, or "
            f"convert it: iconv -f {_likely(raw)} -t utf-8 {shlex.quote(path.name)} > utf8.csv"
        ) from error
    except OSError as error:
        raise DataError(f"{path}: cannot be read ({error.strerror}); download it again") from error


def load_map(path: Path) -> Any:
    """Content of a map of arrays or bags, plain data.

    Raises:
        ConfigError: The file cannot be read.
    """
    try:
        return load_yaml(regular_text(path))
    except (OSError, ValueError) as error:
        why = " ".join(str(error).split())
        raise ConfigError(f"data.map={path}: cannot be read ({why}); correct it") from error


def _likely(raw: bytes) -> str:
    """Likely encoding of text other than UTF-8: of Chinese, Japanese or Latin words."""
    for encoding in ("gb2312", "shift_jis", "gb18030"):
        try:
            words = _ASIAN.findall(raw.decode(encoding))
        except UnicodeDecodeError:
            continue
        # an accent and the letter behind it make a sign there, in the middle of a word of Latin
        if words and not any(before or behind for before, behind in words):
            return encoding.replace("2312", "18030")  # has all of it
    return "latin1"


def wide_encoding(raw: bytes) -> str | None:
    """The encoding of a UTF-16 or UTF-32 text, by its mark or its zero bytes; otherwise None.

    Example:
        >>> wide_encoding("file".encode("utf-16")), wide_encoding(b"file,object")
        ('utf-16', None)
    """
    for mark, name in _MARKS.items():
        if raw.startswith(mark):
            return name
    # without a mark: in UTF-16, every other byte of Latin letters is 0, and a text has no 0 else
    even, odd = raw[:2000:2].count(0), raw[1:2000:2].count(0)
    if even + odd <= len(raw[:2000]) // 4:
        return None
    return "utf-16be" if even > odd else "utf-16le"


def check_lines(path: Path, text: str) -> None:
    """Refuses a table with a line longer than any: its cells would take a hundred times the memory.

    Raises:
        DataError: A line is longer than `_MOST_LINE`.
    """
    at, end = 0, len(text)
    while end - at > _MOST_LINE:
        stop = text.find("\n", at)
        if (stop if stop >= 0 else end) - at > _MOST_LINE:
            number = text.count("\n", 0, at) + 1
            raise DataError(f"{path}: line {number} has more than {_MOST_LINE} characters")
        at = stop + 1


def read_rows(path: Path) -> list[list[str]]:
    """The cells of each line of a CSV without a header; [] for an empty line.

    Raises:
        DataError: The file cannot be read, or is not a CSV; names it.
    """
    try:
        text = read_text(path)
        check_lines(path, text)
        # newline="" leaves line ends inside of quoted cells to the parser (docs of csv)
        return list(csv.reader(StringIO(text, newline="")))
    except csv.Error as error:
        raise DataError(f"{path}: not a CSV ({error}); download it again") from error


def matching_files(
    folder: Path, patterns: Sequence[str], layout: str
) -> tuple[list[Path], list[Path]]:
    """Files matching any pattern, each once, in natural order; and other matches, and closed links.

    ``**`` enters links to folders, each folder once.

    Numbers in names sort by value, 2 before 10 and 8.27 before 8.5; see `order.name_keys`. The
    ending matches in any case: ``*.png`` finds ``0.PNG``. Hidden files, and companion files of an
    operating system, are left out.

    Args:
        folder: Folder of the search.
        patterns: Glob patterns relative to ``folder``, see `Path.glob`.
        layout: Name of their layout, for messages.

    Raises:
        ConfigError: A pattern is invalid, or leaves the folder.
        DataError: Two files differ only in the spelling of their ending, jpg and JPG or jpeg.
    """
    found: dict[Path, bool] = {}  # whether a pattern with a file ending has matched
    closed: dict[Path, None] = {}
    for pattern in patterns:
        is_for_files = "." in pattern.rpartition("/")[2]
        for path in _matches(folder, pattern, layout, closed.setdefault):
            found[path] = found.get(path, False) or is_for_files
    seen: dict[str, Path] = {}
    for path in found:
        stem, ending = os.path.splitext(path)
        ending = ending.lower()
        other = seen.setdefault(stem + _ENDINGS.get(ending, ending), path)
        if other is not path:
            raise DataError(
                f"{path}: {other.name} lies beside it, of the same name; remove or rename one"
            )
    keys = name_keys(found)

    @cache
    def place(parent: Path) -> tuple[Any, ...]:
        # folders first, name by name: a file sorts among those of its own folder
        return tuple(map(natural, parent.relative_to(folder).parts))

    files, odd = [], []
    for path in sorted(found, key=lambda path: (*place(path.parent), *keys[path])):
        if path.is_file():
            files.append(path)
        # a folder may match "*" by chance, but not a pattern with an ending
        elif found[path] or not path.is_dir():
            odd.append(path)
    return files, odd + [path for path in closed if path not in odd]


def _matches(
    folder: Path, pattern: str, layout: str, left_out: Callable[[Path], object] = lambda path: None
) -> list[Path]:
    try:
        # a camera writes .MP4, a program .mp4, and glob tells them apart on Linux
        paths = matches(folder, _any_case(pattern), left_out)
        hidden = any(part.startswith(".") for part in Path(pattern).parts)  # named explicitly
        return paths if hidden else without_companions(paths, folder)
    except (ValueError, NotImplementedError) as error:
        raise ConfigError(
            f"layout {layout!r}: pattern {pattern!r}: {error}; give a path from {folder} on, with "
            "** between two slashes, with nothing beside it, e.g. *.png or **/*.png"
        ) from error


def deeper(folder: Path, patterns: Sequence[str], layout: str) -> str:
    """A remark on matching files one folder deeper; "" without any."""
    found = [path for p in patterns for path in _matches(folder, f"*/{p}", layout)]
    if not found:
        return ""
    places = sorted(path.relative_to(folder) for path in found)
    inside = sorted({place.parts[0] for place in places})
    listed = " and ".join(inside[:3]) + (f" and {len(inside) - 3} more" if len(inside) > 3 else "")
    better = folder / ("train" if "train" in inside else inside[0])
    return (
        f", but files one folder deeper, in {listed}, do, such as {places[0].as_posix()}: give one "
        f"of these as the folder ({better})"
    )


def _any_case(pattern: str) -> str:
    """A pattern with its ending in either case."""
    start, dot, ending = pattern.rpartition(".")
    if not dot or not ending.isalnum() or not ending.isascii():
        return pattern
    return start + dot + "".join(f"[{c.lower()}{c.upper()}]" if c.isalpha() else c for c in ending)


def names_below(folder: Path) -> frozenset[str]:
    """Names of all files below a folder, without their folders."""
    return frozenset(name for _, _, names in os.walk(folder) for name in names)


def kind_of(path: Path) -> str:
    """Kind of a path other than a file, in words."""
    if path.is_symlink() and not path.exists():
        return "a link to nothing"
    if path.is_symlink() and path.is_dir():
        return "a link to a folder that is read by another name"
    if path.is_dir():
        return "a folder" if os.access(path, os.R_OK | os.X_OK) else "a folder that cannot be read"
    return "a pipe, socket or device"
