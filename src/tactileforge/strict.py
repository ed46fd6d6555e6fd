"""Plain data to dataclasses, strictly: every field is known, present and of its type."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import MISSING, fields
from typing import Any, TypeVar, get_type_hints

from tactileforge.errors import ConfigError, unknown

_T = TypeVar("_T")


def mapping(where: str, value: Any) -> dict[str, Any]:
    """A copy of a mapping from names.

    Raises:
        ConfigError: It is something else.
    """
    if not isinstance(value, Mapping) or not all(isinstance(key, str) for key in value):
        raise ConfigError(f"{where}: expected names and values, found {type(value).__name__}")
    return dict(value)


def build(kind: type[_T], where: str, given: Any) -> _T:
    """A dataclass from plain data.

    Args:
        kind: The dataclass. Fields may be plain types, lists and dicts of them.
        where: For errors: what is being read.
        given: Values by field.

    Raises:
        ConfigError: A field is unknown, missing or of another type; names it.
    """
    values = mapping(where, given)
    hints = get_type_hints(kind)
    for key in values:
        if key not in hints:
            raise ConfigError(unknown(f"field of {where}:", key, hints))
    for spec in fields(kind):  # type: ignore[arg-type]
        if spec.name in values:
            values[spec.name] = _typed(f"{where}: {spec.name}", values[spec.name], hints[spec.name])
        elif spec.default is MISSING and spec.default_factory is MISSING:
            raise ConfigError(f"{where}: field {spec.name!r} is missing")
    return kind(**values)


def part(name: str, kind: type[_T], given: Mapping[str, Any]) -> _T:
    """A group of options from a configuration.

    Args:
        name: Of the group.
        kind: Its dataclass.
        given: Its keys.

    Raises:
        ConfigError: An unknown key, or a value that does not fit.
    """
    known = [one.name for one in fields(kind)]  # type: ignore[arg-type]
    for key in given:
        if key not in known:
            raise ConfigError(unknown(f"key of {name}", key, known))
    return kind(**given)


def _typed(where: str, value: Any, hint: Any) -> Any:
    """The value, if it is of the type; whole numbers may stand for fractions."""
    kind, inner = getattr(hint, "__origin__", hint), getattr(hint, "__args__", ())
    if kind is float and type(value) is int:
        return float(value)
    good = type(value) is kind
    if good and inner and inner[-1] is not Any:
        items = value.values() if kind is dict else value
        if hasattr(inner[-1], "__origin__"):
            for item in items:
                _typed(where, item, inner[-1])
        else:
            good = all(type(item) is inner[-1] for item in items)
    if not good:
        wanted = str(hint) if inner else hint.__name__
        raise ConfigError(f"{where} is {value!r}, which is not of type {wanted}")
    return value
