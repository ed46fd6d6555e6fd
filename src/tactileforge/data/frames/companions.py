"""Companion files: written beside pictures by operating systems, and no data."""

from __future__ import annotations

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
    return any(
        (part.startswith(".") and part not in (".", "..")) or part.casefold() in _COMPANIONS
        for part in path.parts
    )


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
    return [path for path in paths if not is_companion(path.relative_to(folder))]
