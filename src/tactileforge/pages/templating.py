"""Templates of the pages: Jinja2, with autoescape, from the files beside this module."""

from __future__ import annotations

from collections.abc import Iterable
from functools import cache
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup


@cache
def environment() -> Environment:
    """The environment of the templates; text is escaped unless it is `Markup`."""
    return Environment(
        loader=PackageLoader("tactileforge.pages"),
        autoescape=True,
        undefined=StrictUndefined,  # a typing error in a template fails, where it would print ""
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )


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
