"""Numbers of touch, drawn as pictures by a layout of taxels."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from tactileforge.errors import ConfigError, DataError
from tactileforge.sensors import TaxelLayout
from tactileforge_lerobot.parquet import read_rows
from tactileforge_lerobot.rows import EpisodeRows

#: Sizes of a last axis that may be x, y, z, or x, y, z twice: displacement and force.
_AXES = (3, 6)


class Values(Protocol):
    """Numbers of the frames of a touch feature, read on demand."""

    name: str

    def __len__(self) -> int: ...

    def read(self, indices: Sequence[int]) -> NDArray[np.floating]:
        """Reads frames, float (n, taxels, values of each)."""
        ...


@dataclass(frozen=True, kw_only=True)
class Drawing:
    """How numbers become pictures.

    Attributes:
        span: Change of a number drawn as full colour, for all axes or for each; None where no
            feature holds numbers.
        rest: Number without contact, where the first frame of an episode is none.
        columns: Indices of x, y and z in the last axis, or of z alone; () where the last axis is
            none of values; None where it has one number, or does not exist.
        grid: Rows and columns of the picture; None for those of the feature.
        positions: Row and column of each taxel in the picture; None for a grid, row by row.
    """

    span: float | Sequence[float] | None = None
    rest: float = 0.0
    columns: Sequence[int] | None = None
    grid: Sequence[int] | None = None
    positions: Sequence[Sequence[float]] | None = None

    def arranged(self, shape: Sequence[int], what: str) -> tuple[TaxelLayout, int]:
        """Layout of a feature, and the number of values of each taxel.

        Args:
            shape: Shape of a row of the feature.
            what: Name of the feature, for messages.

        Raises:
            ConfigError: An option is missing, or does not fit the shape.
        """
        if self.span is None:
            raise ConfigError(
                f"{what} holds numbers, which are drawn as pictures: give data.span, the change "
                "that is drawn as full color, in the units of the feature"
            )
        places, values, channels = self._axes(list(shape), what)
        taxels = int(np.prod(places, dtype=int))
        grid = list(self.grid) if self.grid is not None else places
        if len(grid) != 2 or min(grid) < 1:
            raise ConfigError(
                f"{what} has taxels of shape {places}, no rows and columns: give "
                "data.grid=[rows,columns], with data.positions where they are in no grid"
                + (f", or one part of it: data.touch=[{what}/0]" if len(places) > 2 else "")
            )
        layout = TaxelLayout(grid, self.positions, channels, self.span)
        if layout.taxels != taxels:
            given = "data.grid" if self.positions is None else "data.positions"
            raise ConfigError(f"{what} has {taxels} taxels, but {given} has {layout.taxels}")
        return layout, values

    def _axes(self, shape: list[int], what: str) -> tuple[list[int], int, list[int]]:
        """Shape of the taxels, number of values of each, and the drawn ones among them."""
        if self.columns is None:
            if len(shape) > 1 and shape[-1] in _AXES:
                raise ConfigError(
                    f"{what} has the shape {shape}: is its last axis x, y and z, or taxels? Give "
                    "data.columns=[0,1,2], or data.columns=[]"
                )
            if len(shape) > 2 and shape[-1] == 1:
                return shape[:-1], 1, [0]
        if not self.columns:
            return shape, 1, [0]
        if not shape or max(self.columns) >= shape[-1]:
            raise ConfigError(
                f"{what} has the shape {shape}, but data.columns={list(self.columns)}"
            )
        return shape[:-1], shape[-1], list(self.columns)


class ColumnValues:
    """Numbers of a column of a parquet file, read on demand.

    Args:
        rows: Rows of the episode.
        feature: Name of the feature.
        part: Index along the first axis; None for all.
        values: Number of values of a taxel.
    """

    def __init__(self, rows: EpisodeRows, feature: str, part: int | None, values: int) -> None:
        self.rows, self.feature, self.part, self.values = rows, feature, part, values
        self.name = f"{rows.place[0]}, {feature}"
        self.dtype = rows.dtype(feature)

    @property
    def path(self) -> Path:
        """Parquet file of the column."""
        return self.rows.place[0]

    def __len__(self) -> int:
        return len(self.rows)

    def read(self, indices: Sequence[int]) -> NDArray[np.floating]:
        """Reads frames, float (n, taxels, values of each); NaN where nothing is known."""
        path, start = self.rows.place
        parts = [read_rows(path, self.feature, start + i, 1, self.dtype) for i in indices]
        rows = np.concatenate(parts)
        self.rows.check_size(self.feature, rows.shape[1])
        return self._shaped(rows)

    def all(self) -> NDArray[np.floating]:
        """Reads all frames at once."""
        path, start = self.rows.place
        rows = read_rows(path, self.feature, start, len(self), self.dtype)
        self.rows.check_size(self.feature, rows.shape[1])
        return self._shaped(rows)

    def _shaped(self, rows: NDArray[np.floating]) -> NDArray[np.floating]:
        kind = np.float64 if self.dtype in ("float64", "int64", "uint64") else np.float32
        whole = self.rows.cleaned(rows.astype(kind, copy=False))
        shaped = whole.reshape(len(rows), *self.rows.shape(self.feature))
        chosen = shaped if self.part is None else shaped[:, self.part]
        return chosen.reshape(len(rows), -1, self.values)


class DrawnFrames:
    """Frames drawn from numbers, read on demand.

    Args:
        values: Numbers of the frames.
        layout: Layout of the taxels.
        rest: Numbers without contact, (taxels, values of each). A taxel with NaN there is outside
            of the sensor, and drawn as one without contact.
    """

    def __init__(self, values: Values, layout: TaxelLayout, rest: NDArray[np.floating]) -> None:
        self.values, self.layout = values, layout
        self.outside = ~np.isfinite(rest)
        self.rest = np.where(self.outside, 0, rest)

    def __len__(self) -> int:
        return len(self.values)

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width."""
        return self.layout.shape

    def read(self, indices: Sequence[int]) -> NDArray[np.uint8]:
        """Draws frames; see `tactileforge.contracts.Frames`.

        Raises:
            DataError: A taxel of the sensor has no value in a frame.
        """
        for i in indices:
            if not 0 <= i < len(self):
                raise IndexError(f"{self.values.name}: frame {i} of {len(self)}")
        out = np.empty((len(indices), *self.shape, 3), np.uint8)
        if not len(indices):
            return out
        read = self.values.read(indices)
        for place, values in enumerate(read):
            if (~np.isfinite(values) & ~self.outside).any():
                raise DataError(
                    f"{self.values.name}, frame {indices[place]}: values that are not known, of "
                    "taxels that have some in the first frame; leave the episode out"
                )
            shown = np.where(self.outside, 0, values)
            out[place] = self.layout.draw(shown, self.rest)
        return out
