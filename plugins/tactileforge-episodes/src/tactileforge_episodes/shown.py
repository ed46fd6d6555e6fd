"""Pictures of arrays without a map: stacks and encoded images, one per row."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from tactileforge.contracts import Frames
from tactileforge.data import EncodedFrames, LazyImages
from tactileforge.errors import DataError
from tactileforge.reading import Facts


class Rows(Protocol):
    """An array, read in rows on demand."""

    @property
    def facts(self) -> Facts:
        """Shape and type of the array."""

    def rows(self, rows: Sequence[int] | NDArray[np.int64], ahead: bool = False) -> NDArray[Any]:
        """Some rows."""


def pictures_of(values: Rows) -> Frames | None:
    """Pictures of an array, taken to be RGB; None for other values.

    Args:
        values: The array.
    """
    shape, count = values.facts.shape, values.facts.rows
    if values.facts.dtype == np.uint8 and len(shape) == 4 and shape[3] == 3:
        return ArrayFrames(str(values), values.rows, shape)
    if is_encoded(values):
        return EncodedFrames(
            str(values), LazyImages(count, partial(encoded_image, values, range(count)))
        )
    return None


@dataclass(frozen=True)
class ArrayFrames:
    """All rows of an array of pictures.

    Attributes:
        name: Name of the array, for messages.
        rows: Function from numbers of rows to them.
        sizes: Shape of the array, (T, H, W, 3).
    """

    name: str
    rows: Callable[[Sequence[int]], NDArray[np.uint8]]
    sizes: tuple[int, ...]

    def __len__(self) -> int:
        return self.sizes[0]

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width."""
        return self.sizes[1], self.sizes[2]

    def read(self, indices: Sequence[int]) -> NDArray[np.uint8]:
        """Reads pictures; see `contracts.Frames.read`."""
        check_frames(indices, len(self), self.name)
        return self.rows(indices)


def encoded_image(ref: Rows, rows: range, i: int) -> bytes:
    """Bytes of an encoded image: those of a cell, or of a row with zeros after their end."""
    cell = ref.rows([rows[i]])[0]
    if isinstance(cell, str):
        raise DataError(f"{ref}, row {rows[i]}: text, no encoded image")
    return cell.tobytes() if isinstance(cell, np.ndarray) else bytes(cell)


def is_encoded(ref: Rows) -> bool:
    """Whether an array holds encoded images, one per row."""
    facts = ref.facts
    flat = facts.dtype == np.uint8 and len(facts.shape) == 2
    return flat or (facts.dtype.kind in "SO" and len(facts.shape) == 1)


def check_frames(indices: Sequence[int], count: int, where: object) -> None:
    """Raises a `DataError` for a frame number out of range."""
    if len(indices) and not 0 <= min(indices) <= max(indices) < count:
        raise DataError(f"{where}: frame {max(indices)} of {count} is not there")
