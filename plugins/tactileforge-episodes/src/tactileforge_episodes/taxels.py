"""Numbers of taxels, and pictures of them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from tactileforge.sensors import TaxelLayout
from tactileforge_episodes.refs import ArrayRef, numbers
from tactileforge_episodes.shown import check_frames


@dataclass(frozen=True)
class Taxels:
    """Numbers of taxels, and the grid of their pictures.

    Attributes:
        ref: The array.
        form: ``grid``, ``points`` or ``flat``; see `map_keys.TaxelKeys`.
        values: Values of each taxel in a ``flat`` row.
        pad: Index along the second axis; None where there is none.
        part: First column (of a grid) or value (of a flat row), and the one after the last; None
            for all.
        limit: Largest magnitude of a number; None for those of float32.
    """

    ref: ArrayRef
    form: str
    values: int = 1
    pad: int | None = None
    part: tuple[int, int] | None = None
    limit: float | None = None

    @property
    def sizes(self) -> tuple[int, ...]:
        """Shape of a row: (rows, columns, values) of a grid, else (taxels, values)."""
        sizes = self.ref.facts.shape[1 if self.pad is None else 2 :]
        if self.form == "flat":
            count = math.prod(sizes) if self.part is None else self.part[1] - self.part[0]
            return (count // self.values, self.values)
        if self.form == "points":
            return (*sizes, 1)[:2]
        columns = sizes[1] if self.part is None else self.part[1] - self.part[0]
        return (sizes[0], columns, *(sizes[2:] or (1,)))

    def read(self, rows: Sequence[int], ahead: bool = False) -> NDArray[np.float64]:
        """Values (T, taxels, values of each)."""
        found = self.ref.rows(rows, ahead)
        found = found if self.pad is None else found[:, self.pad]
        if self.form == "flat":
            found = found.reshape(len(found), -1)
            found = found if self.part is None else found[:, slice(*self.part)]
        elif self.form == "grid" and self.part is not None:
            found = found[:, :, slice(*self.part)]
        out = numbers(found, self.ref, self.limit).astype(np.float64)
        return out.reshape(len(out), -1, self.sizes[-1])


@dataclass(frozen=True)
class TaxelFrames:
    """Taxels drawn as pictures: red, green and blue are x, y and z, grey is no change.

    Attributes:
        taxels: The numbers.
        start: First row.
        stop: Row after the last.
        channels: Which values of a taxel are x, y and z; one alone is z.
        span: Change that is drawn as full colour.
        from_first: Whether the first row is the baseline, else zero.
    """

    taxels: Taxels
    start: int
    stop: int
    channels: tuple[int, ...]
    span: float
    from_first: bool

    def __len__(self) -> int:
        return self.stop - self.start

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of the picture."""
        return grid_of(self.taxels.sizes)

    def read(self, indices: Sequence[int]) -> NDArray[np.uint8]:
        """Draws frames; see `contracts.Frames.read`."""
        check_frames(indices, len(self), self.taxels.ref)
        values = self.taxels.read([self.start + i for i in indices])
        first = self.taxels.read([self.start])[0] if self.from_first else np.zeros_like(values[0])
        first = np.nan_to_num(first)
        layout = _layout(self.taxels.sizes, self.channels, self.span)
        out = np.empty((len(values), *self.shape, 3), np.uint8)
        for i, row in enumerate(values):
            out[i] = layout.draw(np.where(np.isfinite(row), row, first), first)
        return out


@dataclass(frozen=True)
class TaxelTrack:
    """Values of taxels as a track.

    Attributes:
        taxels: The numbers.
        start: First row.
        stop: Row after the last.
    """

    taxels: Taxels
    start: int
    stop: int

    def read(self) -> NDArray[np.float32]:
        """Values (T, taxels, values of each)."""
        return self.taxels.read(range(self.start, self.stop), ahead=True).astype(np.float32)


def grid_of(sizes: tuple[int, ...]) -> tuple[int, int]:
    """Rows and columns of the picture of taxels; points fill a grid that is almost square."""
    if len(sizes) == 3:
        return sizes[0], sizes[1]
    columns = math.isqrt(max(0, sizes[0] - 1)) + 1
    return -(-sizes[0] // columns), columns


@lru_cache(maxsize=64)
def _layout(sizes: tuple[int, ...], channels: tuple[int, ...], span: float) -> TaxelLayout:
    rows, columns = grid_of(sizes)
    places = None
    if len(sizes) == 2 and sizes[0] != rows * columns:
        places = [[i // columns, i % columns] for i in range(sizes[0])]
    return TaxelLayout((rows, columns), places, channels, span)
