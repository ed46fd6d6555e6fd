"""Arrays of a container in the eyes of a guess of its map, used and unused."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactileforge.errors import DataError
from tactileforge.plugins import load_json
from tactileforge.reading import Container, Values, words_of
from tactileforge_episodes.groups import find_groups
from tactileforge_episodes.looks import Look, picture_keys

#: Words of arrays of times, and of other arrays with such words.
TIMES = {"time", "times", "timestamp", "timestamps", "stamp", "stamps", "t", "clock", "secs"}
_NO_TIMES = {"delta", "dt", "duration", "exposure", "remaining", "step", "steps"}
#: Words of commands of a robot.
ACTIONS = {"action", "actions"}
#: Words of arrays of forces.
FORCES = {
    *("force", "forces", "ft", "fts", "wrench", "wrenches", "loadcell", "forcetorque", "netft"),
    *("fx", "fy", "fz", "fxyz"),
}
#: Most arrays that an error names, and rows of which the range of numbers is taken.
_NAMED, _LOOKED_AT = 20, 2000


class FoundArrays:
    """Arrays of the first episode of a container.

    Args:
        file: The container.
        name: Its path, for messages and words of the sensor.

    Attributes:
        within: Template of the groups that are episodes; "" for none.
        group: The fullest of them; "" for none.
        every: Keys of all arrays.
        looks: Arrays of the episode, by key from its group on.
        pictures: Keys of a map for those that are pictures.
        used: Keys of arrays that the map reads, or names as left out.
        doubts: Lines to be checked.

    Raises:
        DataError: The container is damaged.
    """

    def __init__(self, file: Container, name: str) -> None:
        self.file, self.name = file, name
        self.doubts: list[str] = []
        self.used: set[str] = set()
        self.every = file.keys()
        self.within, self.group = find_groups(self.every)
        self.top = f"{self.group}/" if self.group else ""
        inside = [key.removeprefix(self.top) for key in self.every if key.startswith(self.top)]
        self.looks: dict[str, Look] = {}
        self.pictures: dict[str, dict[str, Any]] = {}
        for key in inside:
            try:
                self.looks[key] = look = Look(key, self.array(key).facts, words_of(key))
                if (found := picture_keys(self, look)) is not None:
                    self.pictures[key] = found
            except DataError as error:
                self.doubts.append(f"left out: {error}")

    def array(self, key: str) -> Values:
        """An array of the episode."""
        return self.file.array(self.top + key)

    def values(self, look: Look, rows: int | None = None) -> NDArray[Any]:
        """Rows of an array, the first of many without a number of them."""
        return self.array(look.key).rows(range(rows or min(look.facts.rows, _LOOKED_AT)))

    def free(self) -> list[Look]:
        """Unread arrays so far, apart from pictures."""
        return [
            look
            for key, look in self.looks.items()
            if key not in self.used and key not in self.pictures
        ]

    def clocks(self, rows: int) -> list[Look]:
        """Arrays of times by their names and shapes."""
        return [
            look
            for look in self.looks.values()
            if look.is_numbers and look.has(TIMES) and not look.has(_NO_TIMES)
            if look.facts.shape in ((rows,), (rows, 1))
        ]

    def groups(self) -> Iterable[str]:
        """Groups with possible attributes of the episode or of all."""
        top = self.group.split("/")[0]
        return dict.fromkeys((self.group, "", top, "data", "meta"))

    def place(self, group: str) -> str:
        """Path of a group in a map."""
        return "" if group == self.group else f"/{group}"

    def attribute(self, key: str, name: str) -> Any:
        """An attribute of an array or group; None for none."""
        read = getattr(self.file, "attribute", None)
        found = None if read is None else read(key, name)
        if isinstance(found, np.ndarray | np.generic) and found.size == 1:
            found = found.item()
        return found.decode("utf-8", "replace") if isinstance(found, bytes) else found

    def in_json(self, attribute: str, *names: str) -> Iterator[tuple[str, Any]]:
        """Yields the values of a name in the JSON of an attribute, each with its group."""
        for key in self.groups():
            try:
                value = load_json(str(self.attribute(key, attribute) or "{}"))
            except ValueError:
                continue
            for name in names:
                value = value.get(name) if isinstance(value, Mapping) else None
            if value is not None:
                yield key, value

    def listed(self) -> str:
        """All arrays with their types and shapes, a phrase."""
        return listed(self.looks.values(), self.within)

    def add_left_out(self) -> None:
        """Adds a line about the unread arrays."""
        left = [look for key, look in self.looks.items() if key not in self.used]
        if left:
            self.doubts.append(f"left out: {listed(left)}")


def listed(looks: Iterable[Look], within: str = "") -> str:
    """Arrays with their types and shapes, a phrase.

    Args:
        looks: The arrays.
        within: Template of the groups that all have them; "" for none.
    """
    found = [*looks]
    more = f" and {len(found) - _NAMED} more" if len(found) > _NAMED else ""
    where = f" in each {within}" if within else ""
    return (", ".join(map(str, found[:_NAMED])) or "no arrays") + more + where


def short_names(keys: Sequence[str]) -> dict[str, str]:
    """Shortest distinct names of keys: the last parts, or the differing ones."""
    parts = {key: key.split("/") for key in keys}
    if len({one[-1] for one in parts.values()}) == len(keys):
        parts = {key: one[-1:] for key, one in parts.items()}
    elif len({len(one) for one in parts.values()}) == 1:
        varied = [len({*column}) > 1 for column in zip(*parts.values(), strict=True)]
        parts = {
            key: [part for part, own in zip(one, varied, strict=True) if own]
            for key, one in parts.items()
        }
    return {key: re.sub(r"\W+", "_", "_".join(one)) for key, one in parts.items()}
