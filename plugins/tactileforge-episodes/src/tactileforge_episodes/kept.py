"""Rows of open files, kept in memory for a while."""

from __future__ import annotations

import math
import os
from collections import OrderedDict
from collections.abc import Sequence
from threading import Lock
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from tactileforge.errors import DataError
from tactileforge.reading import Facts

#: Memory of kept rows of this process, bytes.
_KEPT = 1 << 27
#: Size of a block of numbers that is read ahead, bytes.
_STEP = 1 << 20
#: Most bytes of the rows that are asked for at once.
_ASKED = 1 << 30


class Opened(Protocol):
    """An open file with arrays."""

    name: str

    def facts(self, key: str) -> Facts:
        """Description of an array."""

    def read(self, key: str, start: int, stop: int) -> NDArray[Any]:
        """Rows of an array."""


class Kept:
    """Blocks of rows of this process, the latest used."""

    def __init__(self) -> None:
        self._blocks: OrderedDict[tuple[Any, ...], NDArray[Any]] = OrderedDict()
        self._bytes, self._process, self._lock = 0, os.getpid(), Lock()

    def rows(
        self,
        file: Opened,
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
        if len(numbers) * row_bytes(facts) > _ASKED:
            raise DataError(
                f"{file.name}, {key}: {len(numbers)} rows of {row_bytes(facts)} bytes at once, "
                f"where {_ASKED >> 20} MB are the limit; leave it out of the map"
            )
        out = np.empty((len(numbers), *facts.shape[1:]), facts.dtype)
        for number in np.unique(blocks):
            start = int(number) * size
            wanted = np.flatnonzero(blocks == number)
            block = self._block(file, key, start, min(start + size, facts.rows))
            out[wanted] = block[numbers[wanted] - start]
        return out

    def _block(self, file: Opened, key: str, start: int, stop: int) -> NDArray[Any]:
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
    row = row_bytes(facts)
    block = max(1, facts.block)
    return block * max(1, _STEP // (row * block))


def row_bytes(facts: Facts) -> int:
    """Bytes of a row of an array, 1 or more."""
    return max(1, facts.dtype.itemsize * math.prod(facts.shape[1:]))


#: Kept rows of this process.
KEPT = Kept()
