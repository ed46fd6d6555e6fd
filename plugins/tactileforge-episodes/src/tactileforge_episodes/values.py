"""Keys of a map found in a file, and single values read from it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from functools import cached_property
from typing import Any

import numpy as np

from tactileforge.data import stated
from tactileforge.errors import DataError, unknown
from tactileforge.plugins import load_json
from tactileforge.reading import OptionalKeys
from tactileforge_episodes.map_keys import Keys, ReadKeys
from tactileforge_episodes.names import fill, match
from tactileforge_episodes.places import Place, open_place
from tactileforge_episodes.refs import ArrayRef

#: Most numbers of a label that is a row of numbers.
_NUMBERS = 32
#: Most characters of a text.
_TEXT = 1 << 20


class EpisodeArrays:
    """Arrays of one episode file, and of those beside it.

    Args:
        place: The file or group.
        beside: Further files by word; their keys are ``WORD:KEY``.
        within: Group that may hold all arrays; keys start below it.
        inner: Keys below that group, where the others are of other episodes; None for all.
    """

    def __init__(
        self,
        place: Place,
        beside: Mapping[str, Place],
        within: str = "",
        inner: Sequence[str] | None = None,
    ) -> None:
        self.place, self.beside, self._within = place, dict(beside), within
        self._inner = inner
        self._matches: dict[str, list[tuple[str, dict[str, str]]]] = {}
        self._optional: tuple[OptionalKeys, Mapping[str, str]] | None = None

    def count_optional(self, optional: OptionalKeys, of_path: Mapping[str, str]) -> None:
        """Notes the optional keys of the map from now on.

        Args:
            optional: Is told.
            of_path: Placeholders whose values are those of this file alone.
        """
        self._optional = optional, of_path

    @cached_property
    def top(self) -> str:
        """Start of all keys, left out of them."""
        start = f"{self._within}/"
        if self._inner is not None:
            return start
        keys = open_place(self.place).keys()
        return start if self._within and keys and all(k.startswith(start) for k in keys) else ""

    @cached_property
    def keys(self) -> list[str]:
        """Paths of all arrays, in order."""
        every = open_place(self.place).keys() if self._inner is None else self._inner
        found = [key.removeprefix(self.top) for key in every]
        for word, place in self.beside.items():
            found += [f"{word}:{key}" for key in open_place(place).keys()]  # noqa: SIM118
        return found

    @property
    def left(self) -> list[str]:
        """Arrays and groups that are not listed, such as links to other files, a line each."""
        places = (self.place, *self.beside.values()) if self.keys else ()
        return [line for place in places for line in open_place(place).left]

    def ref(self, key: str) -> ArrayRef:
        """The array of a key."""
        word, _, rest = key.partition(":")
        if rest and word in self.beside:
            return ArrayRef(self.beside[word], rest)
        return ArrayRef(self.place, self.top + key)

    def match(self, keys: Keys, values: Mapping[str, str]) -> list[tuple[str, dict[str, str]]]:
        """Arrays of the first fitting template, with the values of its placeholders."""
        found: list[tuple[str, dict[str, str]]] = []
        for template in _several(keys):
            filled = fill(template.removesuffix("?"), values)
            if filled not in self._matches:
                self._matches[filled] = match(filled, self.keys)
            if found := self._matches[filled]:
                break
        if self._optional is not None and any(one.endswith("?") for one in _several(keys)):
            optional, of_path = self._optional
            alike = {name: value for name, value in values.items() if name not in of_path}
            name = fill(_several(keys)[0].removesuffix("?"), alike)
            place = self.place if self._inner is None else f"{self.place}, {self._within}"
            optional.add(name, place, bool(found))
        return [(key, {**values, **its}) for key, its in found]

    def find(self, keys: Keys, values: Mapping[str, str]) -> ArrayRef | None:
        """The array of a key of the map; None where the key may be absent, and is.

        Raises:
            DataError: There is no such array; the message names the nearest.
        """
        if found := self.match(keys, values):
            return self.ref(found[0][0])
        if any(key.endswith("?") for key in _several(keys)):
            return None
        raise self.missing(keys, values)

    def missing(self, keys: Keys, values: Mapping[str, str]) -> DataError:
        """Error of a missing key, with the nearest name."""
        name = fill(_several(keys)[0].removesuffix("?"), values)
        return DataError(f"{self.place}: {unknown('key', name, self.keys)}")

    def text(self, value: str | ReadKeys, values: Mapping[str, str], row: int = 0) -> str | None:
        """A text of the map, filled in or read; None without one."""
        if isinstance(value, str):
            return stated(fill(value, values)) or None
        read = self.value(value, values, row)
        return None if read is None else stated(read) or None

    def value(self, keys: ReadKeys, values: Mapping[str, str], row: int = 0, pad: int = -1) -> Any:
        """A text, number or list of numbers read from the file; None for none.

        Args:
            keys: Key and attribute.
            values: Values of the placeholders.
            row: Row of an array with a time axis.
            pad: Index along the second axis; -1 for all.

        Raises:
            DataError: The key is missing, or its value is no text and no number.
        """
        found = self._attribute(keys, values) if keys.attr else self._cell(keys, values, row, pad)
        if found is None:
            return keys.default
        plain = _plain(found)
        if isinstance(plain, str) and len(plain) > _TEXT:
            raise DataError(f"{self.place}, {keys.array}: a text of {len(plain)} characters")
        if keys.json:
            try:
                plain = load_json(str(plain))
                for depth, name in enumerate(keys.json.split(".")):
                    inner = not depth or isinstance(plain, Mapping)
                    plain = plain.get(name, keys.default) if inner else keys.default
            except (ValueError, AttributeError) as error:
                raise DataError(f"{self.place}, {keys.array}: no JSON ({error})") from error
        return keys.words.get(plain, plain) if isinstance(plain, str) else plain

    def _attribute(self, keys: ReadKeys, values: Mapping[str, str]) -> Any:
        for template in _several(keys.array):
            key = fill(template.removesuffix("?"), values)
            hits = [key] if "{" not in key else [name for name, _ in match(key, self.keys)]
            for name in hits:
                path = name if name.startswith("/") else self.top + name
                found = open_place(self.place).attribute(path.strip("/"), keys.attr)
                if found is not None:
                    return found
        return None

    def _cell(self, keys: ReadKeys, values: Mapping[str, str], row: int, pad: int) -> Any:
        if keys.default is not None and not self.match(keys.array, values):
            return None
        ref = self.find(keys.array, values)
        if ref is None:
            return None
        if keys.whole or not ref.facts.shape:
            return ref.whole()[()]
        if not ref.facts.rows:
            return None
        cell = ref.rows([min(row, ref.facts.rows - 1)], ahead=True)[0]
        inner = np.ndim(cell) and 0 <= pad < np.shape(cell)[0]
        return cell[pad] if inner else cell


def _several(keys: Keys) -> tuple[str, ...]:
    return (keys,) if isinstance(keys, str) else keys


def _plain(value: Any) -> Any:
    """A value of numpy or HDF5 as a text, a number or a list."""
    if isinstance(value, np.ndarray):
        value = value.tolist() if value.size != 1 else value.reshape(-1)[0]
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, bytes):
        return value.decode("utf-8", "replace").strip("\0 \n")
    return value.strip() if isinstance(value, str) else value


def labels_of(found: Iterable[tuple[str, Any]]) -> dict[str, str | float]:
    """Labels: texts and numbers as they are, short rows of numbers one by one."""
    out: dict[str, str | float] = {}
    for name, value in found:
        if isinstance(value, str):
            if stated(value):
                out[name] = stated(value)
        elif isinstance(value, int | float):
            out[name] = float(value)
        elif isinstance(value, list):
            flat = np.ravel(np.asarray(value, dtype=object))[:_NUMBERS]
            numbers = [one for one in flat if isinstance(one, int | float)]
            out |= {f"{name}_{i}": float(one) for i, one in enumerate(numbers)}
    return out
