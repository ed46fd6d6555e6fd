"""Templates of layouts: text with ``{column}`` in it."""

from __future__ import annotations

from string import Formatter

from tactileforge.errors import ConfigError


def template_columns(template: str) -> list[str]:
    """The columns that a template takes values from.

    Raises:
        ConfigError: A brace is not closed, or a column is to be formatted.
    """
    return [name for _, name in template_parts(template) if name is not None]


def template_parts(template: str) -> list[tuple[str, str | None]]:
    """Each text of a template, and the column that follows it; None for none.

    Raises:
        ConfigError: See `template_columns`.
    """
    try:
        parts = list(Formatter().parse(template))
    except ValueError as error:
        raise ConfigError(f"template {template!r}: {error}; write {{column}}") from error
    for _, name, form, conversion in parts:
        if form or conversion:
            raise ConfigError(
                f"template {template!r}: columns are taken as they are; write {{{name}}}"
            )
    return [(text, name) for text, name, _, _ in parts]
