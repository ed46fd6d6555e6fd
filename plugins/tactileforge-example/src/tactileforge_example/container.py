"""A format of arrays: a folder NAME.npy_folder of `.npy` files."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactileforge.contracts import Frames
from tactileforge.data import ArrayFrames
from tactileforge.errors import DataError
from tactileforge.reading import Facts, check_keys, check_size


class NpyArray:
    """An array of a file; only the asked rows are read.

    Args:
        path: The file.

    Raises:
        DataError: It is damaged, holds objects, or is larger than anything that is read.
    """

    def __init__(self, path: Path) -> None:
        try:
            # objects are never loaded: reading them can run code
            self.values = np.load(path, mmap_mode="r", allow_pickle=False)
        except (OSError, ValueError) as error:
            raise DataError(f"{path}: cannot be read ({error}); replace it") from error
        self.path = path
        self.facts = Facts(self.values.shape, self.values.dtype)
        if why := check_size("rows", self.facts.shape, self.facts.dtype, ()):
            raise DataError(f"{path}: {why}")

    def rows(self, rows: Sequence[int] | NDArray[np.int64]) -> NDArray[Any]:
        """Some rows, in the order asked for."""
        asked = np.asarray(rows, np.int64)
        if len(asked) and not 0 <= asked.min() <= asked.max() < self.facts.rows:
            raise DataError(f"{self.path}: {self.facts.rows} rows, not row {asked.max()}")
        return np.asarray(self.values[asked] if self.facts.shape else self.values)


class NpyFolder:
    """A folder of arrays: a container of tactileforge.

    Args:
        path: The folder.
    """

    def __init__(self, path: str) -> None:
        self.root = Path(path)

    def keys(self) -> list[str]:
        """Paths of the arrays, without their ending."""
        found = [path.relative_to(self.root) for path in self.root.rglob("*.npy")]
        check_keys(self.root, len(found))
        return sorted(path.with_suffix("").as_posix() for path in found)

    def array(self, key: str) -> NpyArray:
        """An array by its path."""
        if key not in self.keys():
            raise DataError(f"{self.root}: no array {key}; it has {', '.join(self.keys())}")
        return NpyArray(self.root / f"{key}.npy")

    def times(self, key: str) -> NDArray[np.float64] | None:
        """The times beside an array, `NAME.times.npy`, s; None where there are none."""
        rows, beside = self.array(key).facts.rows, f"{key}.times"
        return self.array(beside).rows(range(rows)) if beside in self.keys() else None

    def frames(self, key: str) -> Frames | None:
        """Pictures of an array of uint8, (T, H, W, 3)."""
        values = self.array(key).values
        is_rgb = values.dtype == np.uint8 and values.ndim == 4 and values.shape[3] == 3
        return ArrayFrames(values) if is_rgb else None
