"""Names with placeholders in braces, matched against keys and paths, and filled in."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from functools import lru_cache

#: A placeholder; with ``#`` for digits alone.
_PLACE = re.compile(r"\{([a-z_][a-z0-9_]{0,30})(#?)\}")


@lru_cache(maxsize=1024)
def _pattern(template: str) -> re.Pattern[str]:
    """Regular expression of a template; a placeholder stays within one part of a path."""
    out, last, seen = "", 0, set()
    for found in _PLACE.finditer(template):
        out += re.escape(template[last : found.start()])
        name, last = found[1], found.end()
        kind = r"\d+" if found[2] else "[^/]+?"
        out += f"(?P={name})" if name in seen else f"(?P<{name}>{kind})"
        seen.add(name)
    return re.compile(out + re.escape(template[last:]))


def placeholders(template: str) -> list[str]:
    """Names in braces of a template, in order."""
    return [name for name, _ in _PLACE.findall(template)]


def fill(template: str, values: Mapping[str, object]) -> str:
    """Fills in the known placeholders; unlike `str.format`, nothing else is looked up.

    Example:
        >>> fill("{side}_{group}", {"side": "left"})
        'left_{group}'
    """
    return _PLACE.sub(lambda found: str(values.get(found[1], found[0])), template)


def match(template: str, names: Iterable[str]) -> list[tuple[str, dict[str, str]]]:
    """Names of a template, each with the values of its placeholders.

    Example:
        >>> match("a/{x}/b", ["a/1/b", "a/b"])
        [('a/1/b', {'x': '1'})]
    """
    pattern = _pattern(template)
    found = ((name, pattern.fullmatch(name)) for name in names)
    return [(name, fits.groupdict()) for name, fits in found if fits]


def natural(name: str) -> list[tuple[int, str]]:
    """Key of the order of names by the numbers in them.

    Example:
        >>> sorted(["demo_10", "demo_9"], key=natural)
        ['demo_9', 'demo_10']
    """
    parts = re.split(r"(\d+)", name)
    return [(int(part) if i % 2 else -1, part) for i, part in enumerate(parts)]


def match_end(template: str, parts: Sequence[str]) -> dict[str, str] | None:
    """Values of the placeholders of a template for the end of a path, or None.

    Example:
        >>> match_end("{task}/{name}.hdf5", ["data", "lift", "0.hdf5"])
        {'task': 'lift', 'name': '0'}
    """
    count = template.count("/") + 1
    fits = _pattern(template).fullmatch("/".join(parts[-count:])) if len(parts) >= count else None
    return fits.groupdict() if fits else None
