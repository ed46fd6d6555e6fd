"""Notes of readers about doubtful, yet readable data."""

from __future__ import annotations

import re

#: Differences between two notes of one kind: numbers, quoted names and paths.
_DETAILS = re.compile(r"'[^']*'|\S*/\S*|\d[\d.e+-]*")


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
