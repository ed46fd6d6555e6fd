"""Companion files: written beside pictures by operating systems, and no data."""

from __future__ import annotations

import os
from pathlib import Path, PurePath

#: Files and folders of Windows, of archives made at a Mac, and of network drives; in lower case.
_COMPANIONS = frozenset(
    {"thumbs.db", "ehthumbs.db", "desktop.ini", "__macosx", "@eadir", "$recycle.bin"}
)


def is_companion(path: PurePath) -> bool:
    """Whether a file is hidden (``._0.png``) or written by an operating system for itself.

    Args:
        path: Path relative to the searched folder; its folders count as well.

    Example:
        >>> is_companion(PurePath("a/._0.png")), is_companion(PurePath("a/Thumbs.db"))
        (True, True)
        >>> is_companion(PurePath("../a/0.png"))
        False
    """
    return any(map(_names_one, path.parts))


def _names_one(part: str) -> bool:
    return (part[:1] == "." and part not in (".", "..")) or part.casefold() in _COMPANIONS


def without_companions(paths: list[Path], folder: Path) -> list[Path]:
    """Paths below a folder, without companion files.

    Example:
        >>> from pathlib import Path
        >>> folder = Path("touches")
        >>> names = ("press.mp4", "._press.mp4")
        >>> [kept] = without_companions([folder / name for name in names], folder)
        >>> kept.name
        'press.mp4'
    """
    kept = []
    inside: dict[str, bool] = {}  # by folder, of which many paths share one
    for path in paths:
        parent, name = os.path.split(path)
        if parent not in inside:
            inside[parent] = not is_companion(PurePath(parent).relative_to(folder))
        if inside[parent] and not _names_one(name):
            kept.append(path)
    return kept
