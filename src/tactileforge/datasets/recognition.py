"""Formats recognised in a folder or file, by their data sets."""

from __future__ import annotations

import logging
import re
import shlex
from functools import cache
from pathlib import Path

from tactileforge.contracts import Guess
from tactileforge.errors import DataError, DataNotFoundError, PluginError
from tactileforge.plugins import registry
from tactileforge.reading import matches
from tactileforge.reading.guessing.view_words import says_touch, words_of
from tactileforge.reading.records import conversion, stack_fault
from tactileforge.util.pointers import check_pointer

#: Largest number of files of an unknown folder that are looked at: pointers of Git LFS, and files
#: that can be converted.
_LOOKED = 1000
#: Column of a taxel of several, and least number of such columns of a table of taxels.
_TAXEL, _TAXELS = re.compile(r"([A-Za-z_]*[A-Za-z])_?\d+"), 4
#: Longest line of names of columns.
_LONGEST = 1 << 16
_TO_NPZ = (
    'python -c "import glob, numpy as n; [n.savez(p[:-4], taxels=n.stack([t[c] for c in '
    "t.dtype.names if c.startswith('{0}')], 1), **{{c: t[c] for c in t.dtype.names if not "
    "c.startswith('{0}')}}) for p in glob.glob('*{1}') for t in [n.genfromtxt(p, delimiter='{2}', "
    'names=True)]]"'
)

log = logging.getLogger(__name__)


@cache
def recognise(path: Path) -> tuple[tuple[str, Guess], ...]:
    """Names of the data sets for a folder or file, with their guesses, best first.

    A package that cannot be imported, or fails, is logged and left out. What a data set says of
    files of its kind without a meaning is the error where no other recognises them.

    Args:
        path: Folder or file.

    Raises:
        DataNotFoundError: There is no such file or folder, or no data set recognises it.
        DataError: None does, and a file is a pointer of Git LFS.
    """
    if not path.exists():
        raise DataNotFoundError(f"{path}: no such folder or file; correct the path")
    found: list[tuple[str, Guess]] = []
    unclear: list[str] = []
    for name in registry.names("datasets"):
        try:
            look = getattr(registry.get("datasets", name), "recognise", None)
            guess = None if look is None else look(path)
        except PluginError as error:
            log.warning("%s", error)
        except DataError as error:
            unclear.append(str(error))
        except Exception as error:  # a fault of one package does not hide the others
            log.warning("data set %s cannot look at %s: %r", name, path, error)
        else:
            found += [] if guess is None else [(name, guess)]
    if not found and unclear:
        raise DataNotFoundError("; ".join(unclear))
    if not found:
        files = sorted(matches(path, "**/*"))[:_LOOKED] if path.is_dir() else [path]
        for file in files:
            check_pointer(file)
        told = [line for one in files if (line := _about(one))]
        if told:
            more = f" (and {len(told) - 1} more files)" if len(told) > 1 else ""
            raise DataNotFoundError(f"{path}: no installed data set recognises it; {told[0]}{more}")
        raise DataNotFoundError(
            f"{path}: no installed data set recognises it, and it has no videos or images; "
            "tactileforge plugins list shows what is installed, docs/datasets.md what can be"
        )
    # of equal scores, the first by name
    return tuple(sorted(found, key=lambda one: -one[1].score))


def _about(path: Path) -> str:
    """Kind of an unread file, and a way to convert it; "" for a file of no such kind."""
    how = conversion(path) or _film(path) or _taxels(path)
    return f"{path} is {how}" if how else stack_fault(path)


def _film(path: Path) -> str:
    """Kind of an unread film, and a way to convert it; "" for another file."""
    name, film = shlex.quote(path.name), shlex.quote(f"{path.stem}.mkv")
    match path.suffix.lower():
        case ".gif":
            return f"a GIF, of 256 colours: ffmpeg -i {name} -c:v ffv1 {film}"
        case ".h264" | ".264" | ".h265" | ".265" | ".hevc":
            return (
                "a film without times: ffmpeg -framerate 30 -i "
                f"{name} -c copy {film}, with its own rate for 30"
            )
        case ".flv" | ".mts" | ".m2ts" | ".wmv" | ".3gp" | ".ogv":
            return f"a film: ffmpeg -i {name} -c:v ffv1 {film}"
    return ""


def _taxels(path: Path) -> str:
    """Kind of a table with a column of each taxel, and a way to convert it; "" for another file."""
    mark = {".csv": ",", ".tsv": "\\t"}.get(path.suffix.lower())
    if mark is None or not path.is_file():
        return ""
    try:
        with path.open(encoding="utf-8-sig", errors="replace") as file:
            header = file.readline(_LONGEST)
    except OSError:
        return ""
    mark = ";" if mark == "," and header.count(";") > header.count(",") else mark
    names = [name.strip(" \"'\n") for name in header.split("\t" if mark == "\\t" else mark)]
    words = [match[1] for name in names if (match := _TAXEL.fullmatch(name))]
    for word in dict.fromkeys(words):
        if words.count(word) >= _TAXELS and says_touch(words_of(word)):
            how = _TO_NPZ.format(word, path.suffix, mark)
            return f"a table of {words.count(word)} taxels, read as an npz; in its folder: {how}"
    return ""
