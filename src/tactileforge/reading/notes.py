"""Notes of readers about doubtful, yet readable data."""

from __future__ import annotations

import re
from collections import deque

#: Differences between two notes of one kind: numbers, quoted names and paths.
_DETAILS = re.compile(r"'[^']*'|\S*/\S*|\d[\d.e+-]*")

#: The latest lists of `add_once`, and their lines.
_KNOWN: deque[tuple[list[str], set[str]]] = deque(maxlen=8)


def add_once(lines: list[str], problem: object) -> None:
    """Adds a problem to a list such as ``skipped``, unless it is there already.

    Args:
        lines: Lines, changed in place.
        problem: Error or line, as text.

    Example:
        >>> skipped = []
        >>> add_once(skipped, "a.mp4: damaged")
        >>> add_once(skipped, "a.mp4: damaged")
        >>> len(skipped)
        1
    """
    known = _known(lines)
    if (line := str(problem)) not in known:
        known.add(line)
        lines.append(line)


def _known(lines: list[str]) -> set[str]:
    """Lines of a list as a set, kept for the latest lists: a list alone takes ever longer."""
    for kept in _KNOWN:
        if kept[0] is lines:
            if len(kept[1]) != len(lines) or not kept[1].issuperset(
                lines[-1:]
            ):  # changed elsewhere
                kept[1].clear()
                kept[1].update(lines)
            return kept[1]
    _KNOWN.append((lines, set(lines)))
    return _KNOWN[-1][1]


class Notes:
    """Notes, the first of each kind with a count of the others."""

    def __init__(self) -> None:
        self._kinds: dict[str, tuple[str, set[str]]] = {}

    def add(self, key: str, doubt: str) -> None:
        """Notes a doubt about a recording; the same one twice counts once.

        Args:
            key: Key of the recording.
            doubt: The doubt, as a phrase; "" for none.
        """
        if doubt:
            kind = _DETAILS.sub("", doubt)
            self._kinds.setdefault(kind, (f"{key}: {doubt}", set()))[1].add(key)

    def lines(self) -> list[str]:
        """One line per kind of note.

        Example:
            >>> notes = Notes()
            >>> notes.add("a", "ends at 2 s")
            >>> notes.add("b", "ends at 3 s")
            >>> notes.lines()
            ['a: ends at 2 s (and 1 more)']
        """
        return [
            first if len(keys) == 1 else f"{first} (and {len(keys) - 1} more)"
            for first, keys in self._kinds.values()
        ]


class OptionalKeys:
    """Optional keys of a map, and the files with them."""

    def __init__(self) -> None:
        self._files: dict[str, dict[str, bool]] = {}

    def add(self, key: str, where: object, is_there: bool) -> None:
        """Notes whether a file has a key; a file with it once keeps it.

        Args:
            key: The key.
            where: Name of the file.
            is_there: Whether the file has the key.
        """
        files = self._files.setdefault(key, {})
        files[str(where)] = files.get(str(where), False) or is_there

    def lines(self) -> list[str]:
        """One line per key of some files only; a key of none is no doubt.

        Example:
            >>> keys = OptionalKeys()
            >>> keys.add("force", "a.npz", True)
            >>> keys.add("force", "b.npz", False)
            >>> keys.lines()[0].partition(";")[0]
            "b.npz: no 'force', which 1 of 2 have"
        """
        out = []
        for key, files in self._files.items():
            absent = [where for where, is_there in files.items() if not is_there]
            if absent and len(absent) < len(files):
                more = f" (nor in {len(absent) - 1} more)" if absent[1:] else ""
                out.append(
                    f"{absent[0]}: no {key!r}{more}, which {len(files) - len(absent)} of "
                    f"{len(files)} have; copy it again, or leave the key out of the map"
                )
        return out
