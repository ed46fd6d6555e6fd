"""Arrays of episodes: facts, and rows kept in memory for a while."""

from __future__ import annotations

import math
import os
from abc import ABC, abstractmethod
from collections import OrderedDict
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from importlib import import_module
from threading import Lock
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from tactileforge.errors import DataError
from tactileforge.reading import MOST_BYTES, Facts
from tactileforge_episodes.members import DAMAGED

if TYPE_CHECKING:
    from tactileforge.contracts import Frames

#: Memory of kept rows of this process, bytes.
_KEPT = 1 << 27
#: Size of a block of numbers that is read ahead, bytes.
_STEP = 1 << 20
#: Most rows of an array that are looked for one by one, or said to be lost.
_MOST_LOST = 1 << 22
#: Most bytes of the rows that are asked for at once.
_ASKED = 1 << 30


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
            block = min(found.block, max(1, MOST_BYTES // _row_bytes(found)))
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
        # late: pictures build on arrays
        pictures_of = import_module("tactileforge_episodes.frames").pictures_of

        found: Frames | None = pictures_of(self.array(key))
        return found

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


class Kept:
    """Blocks of rows of this process, the latest used."""

    def __init__(self) -> None:
        self._blocks: OrderedDict[tuple[Any, ...], NDArray[Any]] = OrderedDict()
        self._bytes, self._process, self._lock = 0, os.getpid(), Lock()

    def rows(
        self,
        file: ArrayFile,
        key: str,
        rows: Sequence[int] | NDArray[np.int64],
        ahead: bool = False,
    ) -> NDArray[Any]:
        """Rows of an array, in the order asked for; each block is read once.

        Args:
            file: The open file.
            key: Path of the array.
            rows: Numbers of the rows.
            ahead: Whether a block has further rows beside those decoded together: for numbers, all
                rows of which are read in turn.

        Raises:
            DataError: A chunk is damaged, or a row is not there.
        """
        if self._process != os.getpid():  # the memory of a forked process is its own
            self.__init__()  # type: ignore[misc]
        facts = file.facts(key)
        size = _block_rows(facts) if ahead else max(1, facts.block)
        if isinstance(rows, range) and len(rows) and rows.step > 0:
            first, last = rows[0], rows[-1]
            start = first // size * size
            if first >= 0 and last < min(start + size, facts.rows):
                block = self._block(file, key, start, min(start + size, facts.rows))
                return block[first - start : last - start + 1 : rows.step].copy()
        numbers = np.asarray(rows, np.int64)
        if len(numbers) and not 0 <= numbers.min() <= numbers.max() < facts.rows:
            raise DataError(f"{file.name}, {key}: {facts.rows} rows, not row {numbers.max()}")
        blocks = numbers // size
        if len(numbers) and (blocks == blocks[0]).all():
            start = int(blocks[0]) * size
            block = self._block(file, key, start, min(start + size, facts.rows))
            return block[numbers - start]
        if len(numbers) * _row_bytes(facts) > _ASKED:
            raise DataError(
                f"{file.name}, {key}: {len(numbers)} rows of {_row_bytes(facts)} bytes at once, "
                f"where {_ASKED >> 20} MB are the limit; leave it out of the map"
            )
        out = np.empty((len(numbers), *facts.shape[1:]), facts.dtype)
        for number in np.unique(blocks):
            start = int(number) * size
            wanted = np.flatnonzero(blocks == number)
            block = self._block(file, key, start, min(start + size, facts.rows))
            out[wanted] = block[numbers[wanted] - start]
        return out

    def _block(self, file: ArrayFile, key: str, start: int, stop: int) -> NDArray[Any]:
        name = (file, key, start, stop)
        with self._lock:
            if name in self._blocks:
                self._blocks.move_to_end(name)
                return self._blocks[name]
        block = file.read(key, start, stop)
        with self._lock:
            if name not in self._blocks and block.nbytes <= _KEPT // 2:
                self._blocks[name] = block
                self._bytes += block.nbytes
            while self._bytes > _KEPT:
                _, old = self._blocks.popitem(last=False)
                self._bytes -= old.nbytes
        return block


def _block_rows(facts: Facts) -> int:
    """Rows read ahead: whole blocks, of about `_STEP` bytes."""
    row = _row_bytes(facts)
    block = max(1, facts.block)
    return block * max(1, _STEP // (row * block))


def _row_bytes(facts: Facts) -> int:
    return max(1, facts.dtype.itemsize * math.prod(facts.shape[1:]))


#: Kept rows of this process.
KEPT = Kept()
