"""Names that are spelled in several ways, and what they have in common."""

from __future__ import annotations

import re
import unicodedata

#: A number, as it is written in a table.
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)(e[+-]?\d+)?")


def plain_name(name: str) -> str:
    """Reduce a name to what is left of it without case, blanks, signs between words and zeros.

    Two names that are reduced to one are one name, spelled in two ways.

    Example:
        >>> plain_name("Red_Cup "), plain_name("red  cup"), plain_name("1.0"), plain_name("01")
        ('red cup', 'red cup', '1', '1')
    """
    text = unicodedata.normalize("NFKC", name)
    # characters without a width, as of a file that begins with a byte order mark
    text = "".join(one for one in text if unicodedata.category(one) != "Cf")
    words = " ".join(re.sub(r"[_\-\s]+", " ", text).casefold().split())
    if _NUMBER.fullmatch(text.strip()):
        return f"{float(text):.15g}"
    return words


def is_blank(name: str) -> bool:
    """Whether a name has nothing to read, or stands for an empty cell.

    Example:
        >>> is_blank("  "), is_blank("nan"), is_blank("nano")
        (True, True, False)
    """
    return plain_name(name) in ("", "nan", "none", "null", "n/a", "na")
