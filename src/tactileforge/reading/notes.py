"""Notes of readers about doubtful, yet readable data."""

from __future__ import annotations

import re

#: Differences between two notes of one kind: numbers, quoted names and paths.
_DETAILS = re.compile(r"'[^']*'|\S*/\S*|\d[\d.e+-]*")


class Lines(list[str]):
    """Lines, searched as fast in many as in few; for `add_once`."""

    _seen: set[str] | None = None

    def append(self, line: str) -> None:
        """Adds a line at the end."""
        super().append(line)
        if self._seen is not None:
            self._seen.add(line)

    def __contains__(self, line: object) -> bool:
        """Whether the line is one of them."""
        if self._seen is None or len(self._seen) != len(self):  # changed by another method
            self._seen = set(self)
        return line in self._seen


def add_once(lines: list[str], problem: object) -> None:
    """Adds a problem to a list such as ``skipped``, unless it is there already.

    Args:
        lines: Lines, changed in place; of many, make it `Lines`.
        problem: Error or line, as text.

    Example:
        >>> skipped = Lines()
        >>> add_once(skipped, "a.mp4: damaged")
        >>> add_once(skipped, "a.mp4: damaged")
        >>> skipped
        ['a.mp4: damaged']
    """
    if (line := str(problem)) not in lines:
        lines.append(line)


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
