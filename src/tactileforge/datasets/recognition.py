"""Formats recognised in a folder or file, by their data sets."""

from __future__ import annotations

import logging
from functools import cache
from pathlib import Path

from tactileforge.contracts import Guess
from tactileforge.errors import DataNotFoundError, PluginError
from tactileforge.plugins import registry
from tactileforge.reading import matches
from tactileforge.util.pointers import check_pointer

#: Files of an unknown folder that may be pointers of Git LFS.
_LOOKED = 1000

log = logging.getLogger(__name__)


@cache
def recognise(path: Path) -> tuple[tuple[str, Guess], ...]:
    """Names of the data sets for a folder or file, with their guesses, best first.

    A package that cannot be imported, or fails, is logged and left out.

    Args:
        path: Folder or file.

    Raises:
        DataNotFoundError: There is no such file or folder, or no data set recognises it.
        DataError: None does, and a file is a pointer of Git LFS.
    """
    if not path.exists():
        raise DataNotFoundError(f"{path}: no such folder or file; correct the path")
    found: list[tuple[str, Guess]] = []
    for name in registry.names("datasets"):
        try:
            look = getattr(registry.get("datasets", name), "recognise", None)
            guess = None if look is None else look(path)
        except PluginError as error:
            log.warning("%s", error)
        except Exception as error:  # a fault of one package does not hide the others
            log.warning("data set %s cannot look at %s: %r", name, path, error)
        else:
            found += [] if guess is None else [(name, guess)]
    if not found:
        for file in matches(path, "**/*")[:_LOOKED] if path.is_dir() else [path]:
            check_pointer(file)
        raise DataNotFoundError(
            f"{path}: no installed data set recognises it, and it has no videos or images; "
            "tactileforge plugins list shows what is installed, docs/datasets.md what can be"
        )
    # of equal scores, the first by name
    return tuple(sorted(found, key=lambda one: -one[1].score))
