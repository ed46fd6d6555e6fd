"""Results of verbs in a notebook: an object with a page, shown where it is the last of a cell."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

#: Height of a page in a notebook, pixels.
_HEIGHT = 640


@dataclass(frozen=True)
class Shown:
    """What a verb made: a file or folder, its page, and its numbers.

    It is a path for every function that takes one, and a notebook shows the page.

    Attributes:
        path: File or folder that was written.
        page: Its page, one HTML file; None for none.
        rows: Its numbers: a mapping for each row of the table.
        value: The same as objects of the package that made it.
        status: Exit status of the verb on the command line.
    """

    path: Path
    page: Path | None = None
    rows: Sequence[Mapping[str, Any]] = ()
    value: Any = None
    status: int = 0

    def __fspath__(self) -> str:
        """The path, for functions that take one."""
        return str(self.path)

    def __str__(self) -> str:
        """The path and the table, as text."""
        return "\n".join([str(self.path), *self._lines()])

    def _lines(self) -> list[str]:
        from tactileforge.pages.text_tables import align_columns

        if not self.rows:
            return []
        keys = list(self.rows[0])
        return align_columns(
            [keys, *([_said(row.get(key)) for key in keys] for row in self.rows)]
        ).splitlines()

    def _repr_html_(self) -> str:
        """The page in a frame of its own, or the table where there is no page."""
        from tactileforge.pages.templating import piece

        if self.page is not None and self.page.is_file():
            # a plain string, whose markup is escaped: the whole page is one attribute
            return str(piece("shown_page", self.page.read_text("utf-8"), _HEIGHT))
        rows = [{key: _said(row.get(key)) for key in self.rows[0]} for row in self.rows]
        return str(piece("shown_rows", self.path, rows))


def _said(value: Any) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)
