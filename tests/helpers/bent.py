"""Plain data with a bent structure: each key dropped, renamed, retyped, negated, deepened."""

import copy
from collections.abc import Iterator
from typing import Any

Path = tuple[Any, ...]


def _deep(value: Any, levels: int) -> Any:
    for _ in range(levels):
        value = [value]
    return value


def _instead(value: Any) -> Iterator[Any]:
    """Substitutes for a value."""
    yield from (None, True, -1, 0, 10**30, 1e300, float("nan"), "", "x", "\x00/..", [], {})
    yield from ([value], [value, value], {"a": value}, _deep(value, 60))
    if isinstance(value, int | float) and not isinstance(value, bool):
        yield from (-value, value + 1, value + 0.5, value * 10**6, str(value))
    if isinstance(value, str):
        yield from (value + "x", value * 500)
    if isinstance(value, list) and value:
        yield from (value[:-1], value + value, value[::-1])
        yield from (
            [item] * len(value) for item in (None, -1, "a", 1e300, float("nan"), [1, 2], {})
        )
    if isinstance(value, dict) and value:
        yield {f"{key}x": item for key, item in value.items()}


def _places(plain: Any, most: int, path: Path = ()) -> Iterator[tuple[Path, Any]]:
    inner: Any = ()
    if isinstance(plain, dict):
        inner = plain.items()
    elif isinstance(plain, list):
        inner = list(enumerate(plain))[:1]
    for key, value in inner:
        yield (*path, key), value
        if most > 1:
            yield from _places(value, most - 1, (*path, key))


def _changed(plain: Any, path: Path, drop: bool, value: Any = None) -> Any:
    plain = copy.deepcopy(plain)
    place = plain
    for key in path[:-1]:
        place = place[key]
    if drop:
        del place[path[-1]]
    else:
        place[path[-1]] = value
    return plain


def bent(plain: Any, levels: int = 4) -> Iterator[tuple[str, Any]]:
    """Copies of plain data, each with one place changed, and the change in words.

    Args:
        plain: What JSON can hold; of a list the first item alone is changed.
        levels: Levels that are changed.
    """
    for path, value in _places(plain, levels):
        where = ".".join(map(str, path))
        yield f"{where} dropped", _changed(plain, path, drop=True)
        for other in _instead(value):
            yield f"{where} = {str(other)[:40]}", _changed(plain, path, drop=False, value=other)
        if isinstance(path[-1], str):
            twice = _changed(plain, (*path[:-1], f"{path[-1]}2"), drop=False, value=value)
            yield f"{where} twice", twice
            yield f"{where} renamed", _changed(twice, path, drop=True)
