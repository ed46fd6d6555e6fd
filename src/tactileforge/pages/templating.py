"""Templates of the pages: Jinja2, with autoescape, from the files beside this module."""

from __future__ import annotations

import re
from collections.abc import Iterable
from functools import cache
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup, escape

#: Letters of a word from which it may break, and the marks behind which it does.
_LONG = 20
_MARKS = re.compile(r"[/_.,=:@-]+(?=\w)")


@cache
def environment() -> Environment:
    """The environment of the templates; text is escaped unless it is `Markup`."""
    found = Environment(
        loader=PackageLoader("tactileforge.pages"),
        autoescape=True,
        undefined=StrictUndefined,  # a typing error in a template fails, where it would print ""
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    found.filters["breakable"] = breakable
    return found


def breakable(text: str) -> Markup:
    """Escapes text, and lets long names break behind their marks, not in a word.

    Example:
        >>> breakable("a tidy/left_sensor_of_the_mug.mp4")
        Markup('a tidy/<wbr>left_<wbr>sensor_<wbr>of_<wbr>the_<wbr>mug.<wbr>mp4')
    """
    if isinstance(text, Markup):
        return text
    parts = (
        _MARKS.sub("\\g<0>\0", word) if len(word) > _LONG else word
        for word in re.split(r"(\s+)", str(text))
    )
    return Markup(str(escape("".join(parts))).replace("\0", "<wbr>"))


def piece(name: str, *values: Any) -> Markup:
    """Renders a macro of ``pieces.html``.

    Args:
        name: Name of the macro.
        values: Arguments of the macro.
    """
    return Markup(getattr(_pieces(), name)(*values))


@cache
def _pieces() -> Any:
    return environment().get_template("pieces.html").module


def joined(parts: Iterable[str]) -> Markup:
    """Joins parts of a page and escapes plain text."""
    return Markup().join(parts)
