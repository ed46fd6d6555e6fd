"""Arrays of episodes: facts, and rows kept in memory for a while."""

from __future__ import annotations

import math
import os
from abc import ABC, abstractmethod
from collections import OrderedDict
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from threading import Lock
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactileforge.errors import DataError
from tactileforge_episodes.members import DAMAGED

#: Memory of kept rows of this process, bytes.
_KEPT = 1 << 27
#: Size of a block of numbers that is read ahead, bytes.
_STEP = 1 << 20


@dataclass(frozen=True)
class Facts:
    """Description of an array.

    Attributes:
        shape: Its sizes; the first is time, but for an array without rows.
        dtype: Type of its values; ``object`` for texts or bytes of any length.
        block: Rows that are decoded together.
    """

    shape: tuple[int, ...]
    dtype: np.dtype[Any]
    block: int

    @property
    def rows(self) -> int:
        """Number of rows; 1 for a single value."""
        return self.shape[0] if self.shape else 1


class Container(ABC):
    """Arrays by path in one file or group, and their episodes.

    Args:
        name: Path of the file or group, for messages.
    """

    #: What mends a damaged file.
    fix = "download it again"

    def __init__(self, name: str) -> None:
        self.name = name
        self._facts: dict[str, Facts] = {}

    @abstractmethod
    def keys(self) -> list[str]:
        """Paths of the arrays, in order; folders of chunks are not listed."""

    def facts(self, key: str) -> Facts:
        """Description of an array.

        Raises:
            DataError: It is missing, damaged or refused.
        """
        if key not in self._facts:
            with self._naming(key):
                self._facts[key] = self._look(key)
        return self._facts[key]

    def read(self, key: str, start: int, stop: int) -> NDArray[Any]:
        """Rows of an array; all of one without rows.

        Raises:
            DataError: A chunk is damaged.
        """
        facts = self.facts(key)
        with self._naming(key, f"rows {start} to {stop - 1}: "):
            return self._rows(key, facts, start, stop)

    def attribute(self, key: str, name: str) -> Any:
        """An attribute of an array or group; None where there is none."""
        return None

    @abstractmethod
    def _look(self, key: str) -> Facts:
        """Description of an array, read for the first time."""

    @abstractmethod
    def _rows(self, key: str, facts: Facts, start: int, stop: int) -> NDArray[Any]:
        """Rows of an array of known description."""

    @contextmanager
    def _naming(self, key: str, what: str = "") -> Iterator[None]:
        """Gives errors of decoders the name of the array."""
        try:
            yield
        except DAMAGED as error:
            raise self._wrong(key, f"{what}{error}") from error

    def _wrong(self, key: str, why: str) -> DataError:
        return DataError(f"{self.name}, {key}: cannot be read ({why}); {self.fix}")


def is_sane(shape: Sequence[int], dtype: np.dtype[Any], most: int = 1 << 50) -> bool:
    """Whether sizes are those of a possible array, of at most so many bytes."""
    return all(size >= 0 for size in shape) and math.prod(shape) * (dtype.itemsize or 1) <= most


class Kept:
    """Blocks of rows of this process, the latest used."""

    def __init__(self) -> None:
        self._blocks: OrderedDict[tuple[Any, ...], NDArray[Any]] = OrderedDict()
        self._bytes, self._process, self._lock = 0, os.getpid(), Lock()

    def rows(
        self,
        file: Container,
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
        numbers = np.asarray(rows, np.int64)
        if len(numbers) and not 0 <= numbers.min() <= numbers.max() < facts.rows:
            raise DataError(f"{file.name}, {key}: {facts.rows} rows, not row {numbers.max()}")
        blocks = numbers // size
        if len(numbers) and (blocks == blocks[0]).all():
            start = int(blocks[0]) * size
            block = self._block(file, key, start, min(start + size, facts.rows))
            return block[numbers - start]
        out = np.empty((len(numbers), *facts.shape[1:]), facts.dtype)
        for number in np.unique(blocks):
            start = int(number) * size
            wanted = np.flatnonzero(blocks == number)
            block = self._block(file, key, start, min(start + size, facts.rows))
            out[wanted] = block[numbers[wanted] - start]
        return out

    def _block(self, file: Container, key: str, start: int, stop: int) -> NDArray[Any]:
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
    row = max(1, facts.dtype.itemsize * math.prod(facts.shape[1:]))
    block = max(1, facts.block)
    return block * max(1, _STEP // (row * block))


#: Kept rows of this process.
KEPT = Kept()
