"""Plain data to objects, strictly: every key is known, present and of its type.

The dataclass is the only place of a key, its default and its meaning: `build` makes one from the
values of a command, a YAML or a JSON file, `node` returns its defaults as a configuration, and
`describe` prints them with their meanings from the docstring.
"""

from __future__ import annotations

import inspect
import json
import re
import textwrap
import types
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import MISSING, Field, fields, is_dataclass
from typing import Any, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

from tactileforge.errors import ConfigError, check_names, unknown

_T = TypeVar("_T")

#: Placeholder of a required value in a configuration.
TO_GIVE = "???"
#: Longest value that an error repeats, characters.
_LONGEST = 100


def mapping(where: str, value: Any) -> dict[str, Any]:
    """Copies a mapping from names to values.

    Raises:
        ConfigError: The value is not a mapping, or has a key that is not a string.
    """
    if not isinstance(value, Mapping) or not all(isinstance(key, str) for key in value):
        found = "nothing" if value is None else type(value).__name__
        raise ConfigError(f"{where}: expected names and values, found {found}")
    return dict(value)


def build(kind: type[_T], where: str, given: Any) -> _T:
    """Builds a dataclass from plain data.

    Args:
        kind: The dataclass. Its fields may be dataclasses, and hold lists, mappings and unions;
            ``metadata={"example": ...}`` has an example value of a required field, for errors.
        where: Name of the source, for errors; "" for the command line.
        given: Values by field.

    Raises:
        ConfigError: A field is unknown, missing or of another type; names it, and the nearest.
    """
    values = mapping(where, given)
    hints = get_type_hints(kind)
    known = [spec.name for spec in _fields(kind)]
    for old, now in getattr(kind, "RENAMED", {}).items():
        if old in values and old not in known and (names := [new for new in now if new in known]):
            said = f" ({now[names[0]]})" if now[names[0]] else ""
            raise ConfigError(f"{where}: {old!r} is now called {names[0]!r}{said}")
    check_names(f"key of {where}" if where else "key", values, known)
    missing = [
        spec
        for spec in _fields(kind)
        if spec.default is MISSING and spec.default_factory is MISSING
        if values.get(spec.name, TO_GIVE) == TO_GIVE
    ]
    if missing and not where:
        raise ConfigError(f"give {' '.join(f'{spec.name}=...' for spec in missing)}")
    if missing:
        key, example = missing[0].name, missing[0].metadata.get("example")
        fix = f"; for example {key}: {example}" if example else ""
        raise ConfigError(f"{where}: {key!r} is missing{fix}")
    return kind(
        **{key: typed(_below(where, key), value, hints[key]) for key, value in values.items()}
    )


def _below(where: str, key: str) -> str:
    """A key's place: ``pack.filter`` in a configuration, ``a/file.yaml: a.licence`` in a file."""
    dotted = re.fullmatch(r"(.*: )?[a-z_]+(\.[a-z_]+)*(?<!\.yaml|\.json)", where)
    return f"{where}.{key}" if dotted else f"{where}: {key}" if where else key


def typed(where: str, value: Any, hint: Any) -> Any:
    """Converts a value to a type, strictly.

    Whole numbers may stand for fractions, lists for tuples, and mappings for dataclasses.

    Args:
        where: Name of the value, for errors.
        value: Value to convert, plain data.
        hint: Type of the value; a type that cannot be checked accepts everything.

    Raises:
        ConfigError: The value is of another type, or a dataclass refuses it.
    """
    if is_dataclass(hint) and isinstance(hint, type):
        return value if isinstance(value, hint) else build(hint, where, value or {})
    fits, made = _fit(where, value, hint)
    if not fits:
        if isinstance(value, str) and (choices := _choices(hint)):
            file, colon, key = where.rpartition(": ")
            raise ConfigError(f"{file}{colon}{unknown(key, value, choices)}")
        takes_list = get_origin(hint) in (list, tuple, Sequence) and isinstance(value, str)
        fix = f"; give a list: [{_short(value)[1:-1]}]" if takes_list else ""
        is_class = get_origin(hint) is None and isinstance(hint, type)
        # without modules, and in the words of YAML
        name = re.sub(r"\b([a-z_]+\.)+", "", str(hint)).replace("NoneType", "null")
        name = hint.__name__ if is_class else name
        raise ConfigError(f"{where} is {_short(value)}, which is not of type {name}{fix}")
    return made


def _choices(hint: Any) -> list[str]:
    """Choices of a type of a few words, or null; [] for other types."""
    union = get_origin(hint) in (Union, types.UnionType)
    kinds = [kind for kind in (get_args(hint) if union else (hint,)) if kind is not type(None)]
    if any(get_origin(kind) is not Literal for kind in kinds):
        return []
    return [str(word) for kind in kinds for word in get_args(kind)]


def _fit(where: str, value: Any, hint: Any) -> tuple[bool, Any]:
    """Whether a value is of a type, and the converted value."""
    origin, inner = get_origin(hint), get_args(hint)
    if hint in (None, type(None)):
        return value is None, value
    if origin in (Union, types.UnionType):
        return _first(where, value, inner)
    if origin is Literal:
        return value in inner, value
    if hint is float:
        # type(), not isinstance: True is an int in Python
        good = type(value) in (int, float)
        return good, float(value) if good else value
    if hint in (int, str, bool):
        return type(value) is hint, value
    if origin in (list, tuple, Sequence):
        return _items(where, value, origin, inner)
    if hint in (list, tuple):
        return isinstance(value, list | tuple), value
    if dict in (origin, hint) or origin is Mapping:
        return _pairs(where, value, inner)
    if is_dataclass(hint) and isinstance(hint, type):
        good = isinstance(value, Mapping | hint)
        return good, typed(where, value, hint) if good else value
    return True, value


def _first(where: str, value: Any, hints: Sequence[Any]) -> tuple[bool, Any]:
    """The first fitting type of several; the value's own type is tried first."""
    # otherwise a whole number would become a fraction in the union float | int
    for hint in sorted(hints, key=lambda hint: hint is not type(value)):
        fits, made = _fit(where, value, hint)
        if fits:
            return True, made
    return False, value


def _items(where: str, value: Any, origin: Any, inner: Sequence[Any]) -> tuple[bool, Any]:
    if not isinstance(value, list if origin is list else list | tuple):
        return False, value
    fixed = origin is tuple and inner and inner[-1] is not Ellipsis
    if fixed and len(value) != len(inner):
        return False, value
    hints = inner if fixed else [inner[0]] * len(value)
    rows = [_fit(where, item, hint) for item, hint in zip(value, hints, strict=True)]
    made = [item for _, item in rows]
    return all(fits for fits, _ in rows), tuple(made) if origin is tuple else made


def _pairs(where: str, value: Any, inner: Sequence[Any]) -> tuple[bool, Any]:
    if not isinstance(value, Mapping):
        return False, value
    key, item = inner or (Any, Any)
    rows = {name: _fit(f"{where}.{name}", row, item) for name, row in value.items()}
    good = all(fits for fits, _ in rows.values()) and all(_fit(where, n, key)[0] for n in rows)
    return good, {name: made for name, (_, made) in rows.items()}


def _short(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= _LONGEST else f"{text[: _LONGEST - 3]}..."


def _fields(kind: Any) -> Sequence[Field[Any]]:
    return [spec for spec in fields(kind) if spec.init]


def _default(spec: Field[Any]) -> Any:
    if spec.default_factory is not MISSING:
        return spec.default_factory()
    return TO_GIVE if spec.default is MISSING else spec.default


def node(kind: type[Any]) -> dict[str, Any]:
    """The keys of a dataclass with their defaults, as plain data; `TO_GIVE` for required ones."""
    return {spec.name: _plain(_default(spec)) for spec in _fields(kind)}


def _plain(value: Any) -> Any:
    if is_dataclass(value) and not isinstance(value, type):
        return {spec.name: _plain(getattr(value, spec.name)) for spec in _fields(value)}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, Mapping):
        return {key: _plain(item) for key, item in value.items()}
    return value


def meanings(kind: type[Any]) -> dict[str, str]:
    """Descriptions of fields, from the docstring of their dataclass; one line each."""
    return _meanings([base for base in kind.__mro__ if is_dataclass(base)], "Attributes")


def arguments(kind: type[Any]) -> dict[str, str]:
    """Descriptions of a constructor's arguments, from the docstrings of a class and its bases."""
    return _meanings(kind.__mro__, "Args")


def _meanings(kinds: Sequence[type[Any]], section: str) -> dict[str, str]:
    """Rows of a section of docstrings; a class wins over its bases."""
    meanings: dict[str, str] = {}
    for kind in reversed(kinds):
        for text in (kind.__doc__, vars(kind).get("__init__", kind).__doc__):
            meanings |= rows_of(text or "", section)
    return meanings


def rows_of(docstring: str, section: str = "Args") -> dict[str, str]:
    """Descriptions of a section of one docstring, by name."""
    _, _, text = inspect.cleandoc(docstring).partition(f"{section}:\n")
    block = re.split(r"\n\S|\n\n(?! )", text)[0]
    rows = re.findall(r"^    (\w+): (.*(?:\n {5,}.*)*)", block, re.MULTILINE)
    return {name: re.sub(r"\s+", " ", said).strip() for name, said in rows}


def describe(kind: type[Any]) -> str:
    """The keys of a dataclass as YAML, with their meanings and defaults.

    Example:
        >>> from dataclasses import dataclass
        >>> @dataclass
        ... class Size:
        ...     '''A size.
        ...
        ...     Attributes:
        ...         rows: How many; None for all.
        ...     '''
        ...
        ...     rows: int | None = None
        >>> print(describe(Size))
        # How many; null for all.
        rows: null
    """
    return "\n".join(_lines(kind))


def _lines(kind: type[Any], indent: str = "") -> Iterator[str]:
    said, hints = meanings(kind), get_type_hints(kind)
    for spec in _fields(kind):
        yield from comment(said.get(spec.name, ""), indent)
        hint = hints[spec.name]
        if is_dataclass(hint) and isinstance(hint, type):
            yield f"{indent}{spec.name}:"
            yield from _lines(hint, indent + "  ")
        else:
            yield f"{indent}{spec.name}: {written(_plain(_default(spec)))}"


def comment(meaning: str, indent: str = "") -> list[str]:
    """The meaning of a key as comment lines of a YAML."""
    words = re.sub(r"\bNone\b", "null", meaning).replace("`", "")
    return [f"{indent}# {line}" for line in textwrap.wrap(words, 96 - len(indent))]


def written(value: Any) -> str:
    """A default, as YAML."""
    if isinstance(value, str):
        return value if value else '""'
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(written, value))}]"
    return json.dumps(value, default=str)
