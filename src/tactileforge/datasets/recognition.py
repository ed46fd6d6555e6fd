"""Formats recognised in a folder or file, by their data sets."""

from __future__ import annotations

import logging
import shlex
from functools import cache
from pathlib import Path

from tactileforge.contracts import Guess
from tactileforge.errors import DataError, DataNotFoundError, PluginError
from tactileforge.plugins import registry
from tactileforge.reading import matches
from tactileforge.reading.guessed_media import unread_array
from tactileforge.reading.records import conversion
from tactileforge.util.pointers import check_pointer

#: Largest number of files of an unknown folder that are looked at: pointers of Git LFS, and files
#: that can be converted.
_LOOKED = 1000

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
        files = matches(path, "**/*")[:_LOOKED] if path.is_dir() else [path]
        for file in files:
            check_pointer(file)
        told = [f"{one} is {how}" for one in files if (how := conversion(one) or _film(one))]
        told = told or [line for one in files if (line := unread_array(one))]
        if told:
            raise DataNotFoundError(f"{path}: no installed data set recognises it; {told[0]}")
        raise DataNotFoundError(
            f"{path}: no installed data set recognises it, and it has no videos or images; "
            "tactileforge plugins list shows what is installed, docs/datasets.md what can be"
        )
    # of equal scores, the first by name
    return tuple(sorted(found, key=lambda one: -one[1].score))


def _film(path: Path) -> str:
    """Kind of an unread film, and a way to convert it; "" for another file."""
    if path.suffix.lower() != ".gif":
        return ""
    return f"a GIF, of 256 colours: ffmpeg -i {shlex.quote(path.name)} -c:v ffv1 {path.stem}.mkv"
