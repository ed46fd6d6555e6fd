"""Tables independent of format: entries and their marks, before Markdown, LaTeX or HTML."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Literal

from tactileforge.pages import MINUS
from tactileforge_bench.results.intervals import Interval

DAGGER = "\N{DAGGER}"
PLUS_MINUS = "\N{PLUS-MINUS SIGN}"
ARROWS = {"lower": "\N{DOWNWARDS ARROW}", "higher": "\N{UPWARDS ARROW}"}

Rank = Literal["", "best", "second"]
Tone = Literal["", "good", "bad", "soft", "text"]


@dataclass(frozen=True)
class TableEntry:
    """One entry of a table.

    Attributes:
        text: Plain text, never empty.
        rank: ``best`` is bold, ``second`` underlined.
        marks: Footnotes it refers to.
        tone: Emphasis on a page; it adds nothing to the text.
        below: A second line, in brackets where there is but one.
    """

    text: str
    rank: Rank = ""
    marks: tuple[str, ...] = ()
    tone: Tone = ""
    below: str = ""

    @property
    def line(self) -> str:
        """Title and metric in one line."""
        return f"{self.text} ({self.below})" if self.below else self.text


@dataclass(frozen=True)
class ColumnHead:
    """The head of a column: its name, and its metric and unit."""

    text: str
    below: str = ""


@dataclass(frozen=True)
class Table:
    """A table with the names of the rows in its first column.

    Attributes:
        name: A word, for anchors and labels.
        title: Title in plain text, as all others.
        caption: Explanation for the reader.
        head: Heads of the columns, one each.
        rows: Entries.
        notes: Footnotes: mark and text.
    """

    name: str
    title: str
    caption: str
    head: Sequence[ColumnHead]
    rows: Sequence[Sequence[TableEntry]]
    notes: Sequence[tuple[str, str]] = ()


@dataclass
class Notes:
    """Collects the footnotes of a table; the same text gets the same letter."""

    _letters: dict[str, str] = field(default_factory=dict)
    _own: dict[str, str] = field(default_factory=dict)

    def letter(self, text: str) -> str:
        """The mark of a footnote: a, b, ... z, aa, ..."""
        if text not in self._letters:
            number, word = len(self._letters) + 1, ""
            while number:
                number, rest = divmod(number - 1, 26)
                word = chr(ord("a") + rest) + word
            self._letters[text] = word
        return self._letters[text]

    def own(self, mark: str, text: str) -> str:
        """A footnote with a mark of its own; returns the mark."""
        self._own[mark] = text
        return mark

    def items(self) -> list[tuple[str, str]]:
        """Mark and text, in order."""
        return [*self._own.items(), *((mark, text) for text, mark in self._letters.items())]


def decimals(values: Iterable[float]) -> int:
    """Number of decimals for four digits in the largest value, three at most.

    Example:
        >>> decimals([0.5]), decimals([3.0, 42.31]), decimals([80.83, 1051.03])
        (3, 2, 0)
    """
    top = max((abs(value) for value in values if math.isfinite(value)), default=0.0)
    return min(3, max(0, 3 - math.floor(math.log10(top)))) if top > 0 else 0


def fixed(value: float, digits: int, signed: bool = False) -> str:
    """Formats a finite number with fixed decimals."""
    # + 0.0 turns a rounded -0.0 into 0.0, which is printed without a sign
    rounded = round(value, digits) + 0.0
    return f"{rounded:{'+' if signed else ''}.{digits}f}".replace("-", MINUS)


def plus_minus(interval: Interval, digits: int, signed: bool = False) -> str:
    """A mean, and half the width of its interval if it has one."""
    text = fixed(interval.mean, digits, signed)
    if math.isnan(interval.half):
        return text
    return f"{text} {PLUS_MINUS} {fixed(interval.half, digits)}"


def ranks(values: Sequence[float | None], better: str, digits: int) -> list[Rank]:
    """Marks the best and the second best of a column, compared as printed.

    Equal values share a mark. Nothing is marked where fewer than two have a value.
    """
    # as printed: a reader may not see two equal numbers of which one is marked
    shown = [None if value is None else round(value, digits) for value in values]
    known = [value for value in shown if value is not None]
    if len(known) < 2:
        return [""] * len(shown)
    order = sorted(set(known), reverse=better == "higher")
    names: list[Rank] = ["best", "second"]
    places = dict(zip(order, names, strict=False))
    return [places.get(value, "") if value is not None else "" for value in shown]
