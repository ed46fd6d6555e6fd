"""Words by which programs write that there is no value."""

from __future__ import annotations

#: In lower case: those of pandas, R, spreadsheets, JSON and people.
NO_VALUE = frozenset(
    ("nan", "-nan", "<na>", "nat", "na", "n/a", "n.a.", "#n/a", "#na", "null", "nil", "none")
) | {"?", "??", "-", "--", "\u2013", "\u2014"}


def stated(text: object) -> str:
    """The text of a cell, trimmed; "" where it is empty or says that there is no value.

    Args:
        text: A cell; None is one without a value.

    Example:
        >>> stated(" bolt "), stated("NaN"), stated("N/A"), stated(None)
        ('bolt', '', '', '')
    """
    plain = "" if text is None else str(text).strip()
    return "" if plain.casefold() in NO_VALUE else plain
