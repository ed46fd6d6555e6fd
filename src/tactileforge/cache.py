"""The folder for what can be made or fetched again."""

from __future__ import annotations

import os
from pathlib import Path


def cache_folder(given: str | None = None) -> Path:
    """The folder given, else ``$TACTILEFORGE_CACHE``, else ``tactileforge`` in the user's cache.

    Example:
        >>> cache_folder("kept").name
        'kept'
    """
    if given := given or os.environ.get("TACTILEFORGE_CACHE"):
        return Path(given).expanduser()
    home = os.environ.get("XDG_CACHE_HOME")
    return (Path(home) if home else Path.home() / ".cache") / "tactileforge"
