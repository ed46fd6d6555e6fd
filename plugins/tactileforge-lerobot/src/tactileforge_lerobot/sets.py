"""Data sets below a folder, and their touch features by name."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any

from tactileforge.reading import FINGERS, says_touch, words_of
from tactileforge_lerobot import folder
from tactileforge_lerobot.info import Info

#: Levels of folders searched for data sets, and most folders that are looked into.
_LEVELS, _MOST = 4, 20_000
#: Words in the names of numbers of touch, beside those of `says_touch`.
_NUMBERS = FINGERS | {"pressure", "pressures", "deformation", "shear"}
#: Words in the names of features beside touch: bookkeeping and estimates.
_BESIDE = ("time", "frame_index", "force", "wrench", "torque", "joint", "state.", "_sn")


def find_sets(root: Path) -> dict[str, Path]:
    """Finds the data sets of a folder: itself, or those up to four levels below it.

    Args:
        root: The folder.

    Returns:
        Folder of each data set, by its name in keys, in order; empty where there are none.
    """
    if (root / folder.INFO).is_file():
        return {root.name: root}
    found: list[Path] = []
    _search(root, _LEVELS, [_MOST], found)
    return {f"{root.name}/{path.relative_to(root).as_posix()}": path for path in sorted(found)}


def _search(place: Path, levels: int, left: list[int], found: list[Path]) -> None:
    try:
        inner = sorted(path for path in place.iterdir() if path.is_dir())
    except OSError:
        return
    for path in inner:
        left[0] -= 1
        if path.name.startswith(".") or left[0] < 0:
            continue
        if (path / folder.INFO).is_file():
            found.append(path)
        elif levels > 1:
            _search(path, levels - 1, left, found)


def expanded(names: Sequence[str], features: Sequence[str]) -> list[str]:
    """Replaces names with ``*`` by the features they stand for; others stay as they are."""
    out: list[str] = []
    for name in names:
        found = [one for one in features if fnmatchcase(one, name)] if "*" in name else []
        out += found or [name]
    return out


def touch_numbers(info: Info) -> list[str]:
    """Names of numeric features with a word of touch in them, and two or more numbers."""
    return [name for name, about in info.features.items() if _is_touch(name.lower(), about)]


def _is_touch(name: str, about: dict[str, Any]) -> bool:
    size = 1
    for length in about["shape"]:
        size *= length
    words = words_of(name)
    is_named = says_touch(words) or not _NUMBERS.isdisjoint(words)
    return (
        is_named
        and not any(word in name for word in _BESIDE)
        and about["dtype"] in folder.NUMBERS
        and size > 1
    )


def wrenches(info: Info) -> Iterator[str]:
    """Names of numeric features with forces by their name, of three numbers or more."""
    for name, about in info.features.items():
        is_row = len(about["shape"]) == 1 and about["shape"][0] >= 3
        named = any(part in name.lower() for part in ("force", "wrench"))
        if named and is_row and about["dtype"] in folder.NUMBERS:
            yield name
