"""References to arrays and values of files: plain data, for recordings to be pickled."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import prod
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from tactileforge.errors import DataError
from tactileforge.reading import MOST_BYTES, Facts
from tactileforge_episodes.kept import KEPT
from tactileforge_episodes.places import Place, open_place


@dataclass(frozen=True)
class ArrayRef:
    """An array of a file, opened when it is read.

    Attributes:
        place: The file or group.
        key: Path of the array in it.
    """

    place: Place
    key: str

    def __str__(self) -> str:
        return f"{self.place}, {self.key}"

    @property
    def facts(self) -> Facts:
        """Shape and type of the array."""
        return open_place(self.place).facts(self.key)

    def rows(self, rows: Sequence[int] | NDArray[np.int64], ahead: bool = False) -> NDArray[Any]:
        """Some rows; see `kept.Kept.rows`.

        Raises:
            DataError: A chunk is damaged, or a row is not there.
        """
        return KEPT.rows(open_place(self.place), self.key, rows, ahead)

    def lost(self, start: int, stop: int) -> list[int]:
        """Rows in a range without a stored chunk; [] where no chunk of the array is."""
        file = open_place(self.place)
        found = file.lost(self.key, start, stop)
        return [] if found and file.is_void(self.key) else found

    @property
    def is_void(self) -> bool:
        """Whether the array has rows, and none of its chunks is stored."""
        return open_place(self.place).is_void(self.key)

    def attribute(self, name: str) -> Any:
        """An attribute of the array; None where there is none."""
        return open_place(self.place).attribute(self.key, name)

    def whole(self) -> NDArray[Any]:
        """All values of an array without a time axis.

        Raises:
            DataError: They are more than is read at once.
        """
        facts = self.facts
        if (size := prod(facts.shape) * facts.dtype.itemsize) > MOST_BYTES:
            raise DataError(
                f"{self}: {size >> 20} MB at once, where {MOST_BYTES >> 20} MB are the limit; "
                "correct its shape, or leave it out of the map"
            )
        return open_place(self.place).read(self.key, 0, self.facts.rows)


def numbers(values: NDArray[Any], where: object, limit: float | None) -> NDArray[Any]:
    """Requires numbers as values; float32 with NaN beyond the limit for fractions.

    Args:
        values: Values of an array.
        where: Name of the array, for messages.
        limit: Largest magnitude; None for those of float32.

    Raises:
        DataError: The values are not numbers.
    """
    if values.dtype.kind in "biu":
        return values
    if values.dtype.kind != "f":
        raise DataError(
            f"{where}: {values.dtype} is not a type of numbers; leave it out of the map"
        )
    most = float(np.finfo(np.float32).max) if limit is None else limit
    with np.errstate(over="ignore", invalid="ignore"):
        beyond = np.abs(values) > most
        return np.where(beyond, np.nan, values).astype(np.float32)


@dataclass(frozen=True)
class Track:
    """Values per frame of a recording, read on demand.

    Attributes:
        refs: Arrays, side by side.
        start: First row.
        stop: Row after the last.
        pad: Index along the second axis; None for all.
        ahead: Rows by which the values are ahead; the last row is repeated.
        limit: Largest magnitude of a number; None for those of float32.
    """

    refs: tuple[ArrayRef, ...]
    start: int
    stop: int
    pad: int | None = None
    ahead: int = 0
    limit: float | None = None

    def read(self) -> NDArray[Any]:
        """The values (T, ...); several arrays are flattened and joined along the second axis."""
        rows = np.minimum(np.arange(self.start, self.stop) + self.ahead, self.stop - 1)
        parts = []
        for ref in self.refs:
            values = ref.rows(rows, ahead=True)
            values = values if self.pad is None else values[:, self.pad]
            parts.append(numbers(values, ref, self.limit))
        if len(parts) == 1:
            return parts[0]
        flat = [part.reshape(len(part), -1).astype(np.float32) for part in parts]
        return np.concatenate(flat, axis=1)


class Readable(Protocol):
    """Values read on demand."""

    def read(self) -> NDArray[Any]:
        """The values, one row per frame."""
        ...


class Tracks(Mapping[str, NDArray[Any]]):
    """Tracks of a recording, each read when it is asked for.

    Args:
        tracks: Tracks by name.
    """

    def __init__(self, tracks: Mapping[str, Readable]) -> None:
        self._tracks = dict(sorted(tracks.items()))

    def __getitem__(self, name: str) -> NDArray[Any]:
        return self._tracks[name].read()

    def __iter__(self) -> Iterator[str]:
        return iter(self._tracks)

    def __len__(self) -> int:
        return len(self._tracks)
