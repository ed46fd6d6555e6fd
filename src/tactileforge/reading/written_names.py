"""Names of files as the rows of tables write them."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Iterable, Mapping
from difflib import get_close_matches
from functools import cached_property
from pathlib import Path, PurePosixPath
from posixpath import normpath
from typing import TypeVar

T = TypeVar("T")

#: Largest number of names compared with an unknown one for a suggestion.
_COMPARED = 2000
#: Ending of a file: starts with a letter, other than the last number of 8.5.
ENDING = re.compile(r"\.[A-Za-z]\w*$")
_ABSOLUTE = re.compile(r"/|[A-Za-z]:/")


class WrittenNames:
    """Look-up of touches by name, tolerant of a row's spelling.

    Args:
        names: Names of touches and images, from the folder of the layout.
        folder: Folder of the layout.
        table: Folder of the CSV, from which rows may name them as well.
    """

    def __init__(self, names: Iterable[str], folder: Path, table: Path) -> None:
        self.all = list(dict.fromkeys(names))
        self._inside = ""
        if table != folder and table.is_relative_to(folder):
            self._inside = f"{table.relative_to(folder).as_posix()}/"
        # rows may hold the path through a link, or the one behind it
        self._folders = [_forward(str(path)) for path in (folder.absolute(), folder.resolve())]
        self._exact = {_composed(name): name for name in self.all}
        self._folded: dict[str, str | None] = {}
        for plain, name in self._exact.items():
            twice = plain.casefold() in self._folded  # ambiguous: only the exact case matches
            self._folded[plain.casefold()] = None if twice else name
        self._folder = folder
        # less than a whole path, without folders or ending: where that is unique
        self._short: dict[str, str | None] = {}
        for plain, name in self._exact.items():
            bare = plain.rpartition("/")[2]
            for short in {*ends_of(plain), ENDING.sub("", bare), ENDING.sub("", plain)}:
                known = self._short.setdefault(short, name)
                self._short[short] = name if known == name else None

    def plain(self, written: str) -> str:
        """The path in a row, relative to the folder of the layout."""
        name = written
        # as written first: on Linux, a backslash may belong to the name
        for path in dict.fromkeys((written, _forward(written))):
            name = normpath(path) if path else path
            for folder in self._folders:
                if name.casefold().startswith(f"{folder}/".casefold()):
                    name = name[len(folder) + 1 :]
            if name in self._exact:
                break
        return name

    def find(self, written: str) -> str | None:
        """The touch named by a row; None for no touch, or several."""
        plain = _composed(self.plain(written))
        inside = self._inside + plain
        return (
            self._exact.get(plain)
            or self._folded.get(plain.casefold())
            or self._exact.get(inside)
            or self._short.get(plain)
            or self._short.get(inside)
            or moved_path(plain, self._exact, self._folder)
        )

    def inside(self, written: str) -> list[str]:
        """The touches in the folder named by a row, by its path or the end of it; [] for none."""
        return self._by_folder.get(_composed(self.plain(written)).rstrip("/")) or []

    @cached_property
    def _by_folder(self) -> dict[str, list[str] | None]:
        """Touches of folders, by their paths and the ends of these; None where several have it."""
        folders: dict[str, list[str]] = {}
        for plain, name in self._exact.items():
            for folder in PurePosixPath(plain).parents[:-1]:
                folders.setdefault(folder.as_posix(), []).append(name)
        return by_ends(folders.items()) | folders

    def any_below(self, folder: str) -> bool:
        """Whether a touch lies in a folder."""
        return any(name.startswith(f"{folder}/") for name in self.all)

    def nearest(self, name: str) -> str:
        """The most similar name, preferably with the same last part."""
        last = name.rpartition("/")[2].casefold()
        alike = [one for one in self.all if one.rpartition("/")[2].casefold() == last]
        return get_close_matches(name, (alike or self.all)[:_COMPARED], 1, 0.0)[0]


def is_absolute(path: str) -> bool:
    """Whether a path with forward slashes is absolute, on any system."""
    return _ABSOLUTE.match(path) is not None


def moved_path(path: str, names: Mapping[str, str], folder: Path) -> str | None:
    """What an absolute path of another machine names, by its end with a folder or more.

    Example:
        >>> moved_path("/home/ann/set/images/0.png", {"images/0.png": "0"}, Path("copy"))
        '0'
        >>> moved_path("/home/ann/set/0.png", {"0.png": "0"}, Path("copy"))
        >>> moved_path("/home/ann/set/0.png", {"0.png": "0"}, Path("set"))
        '0'
    """
    if not is_absolute(path) or Path(path).exists():
        return None
    own = f"{folder.resolve().name}/"
    ends = (end.removeprefix(own) for end in ends_of(path) if "/" in end)
    found = (names[end] for end in ends if end in names)
    return next(found, None)


def is_there(path: str, folder: Path) -> bool:
    """Whether a row's path exists below a folder, or its end, of a path from another machine.

    Args:
        path: A path with forward slashes.
        folder: Folder of the layout, or of the table.
    """
    ends = (end for end in ends_of(path) if "/" in end) if is_absolute(path) else ()
    return any((folder / one).exists() for one in (path, *ends))


def _forward(path: str) -> str:
    return path.replace("\\", "/")


def _composed(name: str) -> str:
    """Normal form (NFC) of letters with accents: macOS stores them decomposed."""
    return unicodedata.normalize("NFC", name)


def ends_of(path: str) -> list[str]:
    """Ends of a path from each of its folders on, without the whole.

    Example:
        >>> ends_of("images/mug/0.png")
        ['mug/0.png', '0.png']
    """
    parts = path.split("/")
    return ["/".join(parts[i:]) for i in range(1, len(parts))] or [path]


def by_ends(values: Iterable[tuple[str, T]]) -> dict[str, T | None]:
    """Values by their paths and all ends of these; None for an end of several values.

    Example:
        >>> found = by_ends([("left/mug", 1), ("right/mug", 2), ("right/bolt", 3)])
        >>> found["mug"], found["bolt"], found["left/mug"]
        (None, 3, 1)
    """
    found: dict[str, T | None] = {}
    for path, value in values:
        for end in {path, *ends_of(path)}:
            found[end] = value if found.get(end, value) == value else None
    return found
