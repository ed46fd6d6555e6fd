"""Arrays of files: their facts and their rows."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactileforge.contracts import Frames
from tactileforge.errors import DataError
from tactileforge.reading import MOST_BYTES, Facts
from tactileforge_episodes.kept import KEPT, row_bytes
from tactileforge_episodes.members import DAMAGED
from tactileforge_episodes.shown import pictures_of

#: Most rows of an array that are looked for one by one, or said to be lost.
_MOST_LOST = 1 << 22


class ArrayFile(ABC):
    """Arrays by path in one file or group: a `Container` of tactileforge.

    Args:
        name: Path of the file or group, for messages.

    Attributes:
        left: Arrays and groups that were left out by `keys`, a line each.
    """

    #: What mends a damaged file.
    fix = "download it again"

    def __init__(self, name: str) -> None:
        self.name = name
        self.left: dict[str, None] = {}
        self._facts: dict[str, Facts] = {}
        self._keys: list[str] | None = None

    def keys(self) -> list[str]:
        """Paths of the arrays, in order, listed once; see `Container.keys`."""
        if self._keys is None:
            self._keys = sorted(self._list())
        return [*self._keys]

    def facts(self, key: str) -> Facts:
        """Description of an array.

        Raises:
            DataError: It is missing, damaged or refused.
        """
        if key not in self._facts:
            with self.naming(key):
                found = self._look(key)
            block = min(found.block, max(1, MOST_BYTES // row_bytes(found)))
            self._facts[key] = replace(found, block=block)
        return self._facts[key]

    def read(self, key: str, start: int, stop: int) -> NDArray[Any]:
        """Rows of an array; all of one without rows.

        Raises:
            DataError: A chunk is damaged.
        """
        facts = self.facts(key)
        with self.naming(key, f"rows {start} to {stop - 1}: "):
            return self._rows(key, facts, start, stop)

    def array(self, key: str) -> ArrayView:
        """An array by its name; see `Container.array`."""
        self.facts(key)
        return ArrayView(self, key)

    def times(self, key: str) -> NDArray[np.float64] | None:
        """None: most formats stamp no rows; a map says which array holds the times."""
        self.facts(key)
        return None

    def frames(self, key: str) -> Frames | None:
        """Pictures of an array, taken to be RGB; None for other values."""
        return pictures_of(self.array(key))

    def lost(self, key: str, start: int, stop: int) -> list[int]:
        """Rows in a range without a stored chunk, in an array with others.

        Raises:
            DataError: The array is missing or damaged.
        """
        return []

    def is_void(self, key: str) -> bool:
        """Whether an array has rows, and not one of its chunks is stored."""
        return False

    def attribute(self, key: str, name: str) -> Any:
        """An attribute of an array or group; None where there is none."""
        return None

    @abstractmethod
    def _list(self) -> Iterable[str]:
        """Paths of the arrays; folders of chunks are not among them."""

    @abstractmethod
    def _look(self, key: str) -> Facts:
        """Description of an array, read for the first time."""

    @abstractmethod
    def _rows(self, key: str, facts: Facts, start: int, stop: int) -> NDArray[Any]:
        """Rows of an array of known description."""

    @contextmanager
    def naming(self, key: str, what: str = "") -> Iterator[None]:
        """Gives errors of decoders the name of the array."""
        try:
            yield
        except DAMAGED as error:
            raise self._wrong(key, f"{what}{error}") from error

    def _wrong(self, key: str, why: str) -> DataError:
        return DataError(f"{self.name}, {key}: cannot be read ({why}); {self.fix}")


def check_lost(where: str, count: int) -> None:
    """Refuses an array with too few chunks for its shape, as if that were damaged.

    Args:
        where: Name of the array.
        count: Number of rows without a stored chunk, or of chunks to look for.

    Raises:
        DataError: There are too many.
    """
    if count > _MOST_LOST:
        raise DataError(
            f"{where}: its shape says {count} rows or more that are not stored; download it again"
        )


@dataclass(frozen=True)
class ArrayView:
    """An array of an open file.

    Attributes:
        file: The file.
        key: Path of the array in it.
    """

    file: ArrayFile
    key: str

    def __str__(self) -> str:
        return f"{self.file.name}, {self.key}"

    @property
    def facts(self) -> Facts:
        """Shape and type of the array."""
        return self.file.facts(self.key)

    def rows(self, rows: Sequence[int] | NDArray[np.int64], ahead: bool = False) -> NDArray[Any]:
        """Some rows; see `Kept.rows`."""
        return KEPT.rows(self.file, self.key, rows, ahead)
