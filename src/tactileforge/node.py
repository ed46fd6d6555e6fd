"""Reading a configuration key by key, with errors that name the key."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from difflib import get_close_matches
from typing import Any

from tactileforge.errors import ConfigError, unknown


class Node:
    """A mapping of a configuration whose keys are taken one by one; what is left is an error.

    Args:
        value: The mapping.
        where: Its place, for messages.

    Raises:
        ConfigError: It is no mapping; the methods raise it for a value that does not fit.
    """

    def __init__(self, value: Any, where: str) -> None:
        if not isinstance(value, Mapping):
            raise ConfigError(f"{where}: a mapping belongs here, not {value!r}")
        self.where = where
        self._value = {str(key): item for key, item in value.items()}
        self._known: list[str] = []

    def has(self, key: str) -> bool:
        """Whether the key is given; null counts as not given."""
        self._known.append(key)
        return self._value.get(key) is not None

    def take(self, key: str, kind: type | tuple[type, ...], default: Any = None) -> Any:
        """A value of a type, or the default."""
        if not self.has(key):
            return default
        value = self._value[key]
        kinds = kind if isinstance(kind, tuple) else (kind,)
        if not isinstance(value, kinds) or (isinstance(value, bool) and bool not in kinds):
            names = " or ".join(item.__name__ for item in kinds)
            raise ConfigError(f"{self.where}: {key} is {value!r}, but must be {names}")
        return value

    def need(self, key: str, kind: type | tuple[type, ...], example: str) -> Any:
        """A value that must be given."""
        if not self.has(key):
            near = get_close_matches(key, self._value.keys() - {key}, n=1)
            typo = f" (is {near[0]!r} a slip?)" if near else ""
            raise ConfigError(f"{self.where}: {key} is missing{typo}; for example {key}: {example}")
        return self.take(key, kind)

    def numbers(self, key: str, count: int, default: Iterable[float] | None = None) -> list[float]:
        """A list of so many numbers."""
        values = self.take(key, list, default)
        good = values is not None and len(values) == count
        if not good or not all(isinstance(v, int | float) for v in values):
            raise ConfigError(f"{self.where}: {key} is {values!r}, but must be {count} numbers")
        return list(values)

    def close(self) -> None:
        """Complains of a key that nobody has asked for."""
        for key in self._value:
            if key not in self._known:
                raise ConfigError(unknown(f"key in {self.where}", key, self._known))
