"""Templates of layouts: text with ``{column}`` in it."""

from __future__ import annotations

from string import Formatter

from tactileforge.errors import ConfigError


def template_columns(template: str) -> list[str]:
    """The columns of a template.

    Raises:
        ConfigError: A brace is not closed, or a column has a format.
    """
    return [name for _, name in template_parts(template) if name is not None]


def template_parts(template: str) -> list[tuple[str, str | None]]:
    """The texts of a template, each with the following column, or None.

    Raises:
        ConfigError: A brace is not closed, or a column has a format.
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
