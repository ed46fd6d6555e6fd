"""Search of folders with linked folders, as clusters keep their data."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from pathlib import Path

from tactileforge.data.frames.companions import is_companion


def folders_below(
    root: Path, left_out: Callable[[Path], object] = lambda path: None, hidden: bool = False
) -> Iterator[Path]:
    """Yields a folder and those below it, behind links too, each once by whatever name.

    Args:
        root: The folder.
        left_out: Is told of links to nothing, links to folders that are yielded already (such as
            one around the link), and folders that cannot be entered.
        hidden: Whether hidden folders, and those of an operating system, are entered.
    """
    seen: set[tuple[int, int]] = set()
    # links last: a folder that lies below the root itself keeps its own name
    places: list[Path] = [root]
    links: list[Path] = []
    while places or links:
        place = places.pop() if places else links.pop(0)
        try:
            about = place.stat()
            if (about.st_dev, about.st_ino) in seen:
                left_out(place)
                continue
            with os.scandir(place) as entries:
                inner = sorted(entries, key=lambda entry: entry.name, reverse=True)
        except OSError:
            left_out(place)
            continue
        seen.add((about.st_dev, about.st_ino))
        yield place
        for entry in inner:
            path = place / entry.name
            if not hidden and is_companion(Path(entry.name)):
                continue
            if entry.is_symlink():
                # a link to nothing may have been one to a folder; one with an ending, to a file
                if path.is_dir() or not (path.suffix or path.exists()):
                    links.append(path)
            elif entry.is_dir():
                places.append(path)


def matches(
    root: Path, pattern: str, left_out: Callable[[Path], object] = lambda path: None
) -> list[Path]:
    """Paths below a folder by a pattern; ``**`` enters links to folders too.

    Args:
        root: The folder.
        pattern: Glob pattern, see `Path.glob`.
        left_out: Is told of links and folders that are not entered, see `folders_below`.

    Raises:
        ValueError: The pattern is invalid.
        NotImplementedError: It is an absolute path.
    """
    parts = pattern.split("/")
    if "**" not in parts:
        for place, part in enumerate(parts[:-1], 1):
            for path in root.glob("/".join(parts[:place])) if "*" in part else ():
                if path.is_symlink() and not path.exists():
                    left_out(path)
        return _once(list(root.glob(pattern)), root, left_out)
    place = parts.index("**")
    above, below = "/".join(parts[:place]), "/".join(parts[place + 1 :])
    hidden = any(part.startswith(".") for part in parts if part not in (".", ".."))
    found: dict[Path, None] = {}
    for start in root.glob(above) if above else [root]:
        for folder in folders_below(start, left_out, hidden) if start.is_dir() else ():
            found |= dict.fromkeys(matches(folder, below, left_out) if below else [folder])
    return list(found)


def _once(paths: list[Path], root: Path, left_out: Callable[[Path], object]) -> list[Path]:
    """Paths without those in a link to a folder of others."""
    places = dict.fromkeys(path.parent for path in paths)
    if len(places) < 2:
        return paths
    folders: dict[str, list[Path]] = {}
    for place in places:
        folders.setdefault(os.path.realpath(place), []).append(place)
    above = os.path.realpath(root)
    again: set[Path] = set()
    for where, names in folders.items():
        # the folder itself before links to it
        first = min(names, key=lambda one: os.path.join(above, one.relative_to(root)) != where)
        again |= {*names} - {first}
    for place in again:
        left_out(place)
    return [path for path in paths if path.parent not in again]
