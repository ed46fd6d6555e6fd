"""Words of programs for a missing value."""

from __future__ import annotations

#: Words for no value, in lower case: of pandas, R, spreadsheets, JSON and people.
NO_VALUE = frozenset(
    ("nan", "-nan", "<na>", "nat", "na", "n/a", "n.a.", "#n/a", "#na", "null", "nil", "none")
) | {"?", "??", "-", "--", "\u2013", "\u2014"}


def stated(text: object) -> str:
    """Text of a cell, trimmed; "" for an empty cell or a word for a missing value.

    Args:
        text: Content of a cell; None for no value.

    Example:
        >>> stated(" bolt "), stated("NaN"), stated("N/A"), stated(None)
        ('bolt', '', '', '')
    """
    plain = "" if text is None else str(text).strip()
    return "" if plain.casefold() in NO_VALUE else plain
