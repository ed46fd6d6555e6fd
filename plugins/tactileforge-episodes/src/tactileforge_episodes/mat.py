"""Variables of MATLAB files: version 5 with scipy, 7.3 as HDF5."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from math import prod
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactileforge.errors import DataError
from tactileforge.reading import Facts, check_keys
from tactileforge_episodes.arrays import ArrayFile
from tactileforge_episodes.hdf import HdfFile
from tactileforge_episodes.mat_limits import check_mat5
from tactileforge_episodes.packages import need
from tactileforge_episodes.slices import Slice

#: Most bytes of a file of version 5, whose variables are read whole.
_MOST = 1 << 31


def open_mat(name: str, file: Slice) -> ArrayFile:
    """Opens the variables of a .mat; fields of structs are ``data/force``.

    Args:
        name: Path of the file, for messages.
        file: The open file.

    Raises:
        DataError: It is no .mat, or too large to be read whole.
        ConfigError: scipy is not installed, which version 5 needs.
    """
    is_hdf5 = file.read(10) == b"MATLAB 7.3"
    file.seek(0)
    return Mat73File(name, file) if is_hdf5 else Mat5File(name, file)


class Mat73File(HdfFile):
    """Variables of MATLAB 7.3: data sets of HDF5 with their axes turned round."""

    def _list(self) -> list[str]:
        # references of cells
        return [key for key in super()._list() if not key.startswith("#")]

    @cached_property
    def _length(self) -> int:
        shapes = []
        for key in self.keys():
            try:
                shapes.append(_without_ones(super()._look(key).shape[::-1]))
            except DataError:  # named when it is asked for
                continue
        return _rows_of(shapes)

    def _look(self, key: str) -> Facts:
        facts = super()._look(key)
        shape = _without_ones(facts.shape[::-1])
        if _is_last(shape, self._length):
            shape = (shape[-1], *shape[:-1])
        return replace(facts, shape=shape, block=1)

    def _rows(self, key: str, facts: Facts, start: int, stop: int) -> NDArray[Any]:
        found = self._sets[key]
        self.check_chunks(key, 0, found.shape[0] if found.ndim else 1)  # axes are turned round
        if not facts.shape:
            return np.asarray(found[()]).reshape(())
        if len(facts.shape) < found.ndim:  # a vector
            return np.asarray(found[()]).ravel()[start:stop]
        if _is_last(found.shape[::-1], self._length):
            return np.moveaxis(np.asarray(found[start:stop]).T, -1, 0)
        return np.asarray(found[..., start:stop]).T

    def lost(self, key: str, start: int, stop: int) -> list[int]:
        """Never-written rows: not known, as axes are turned round."""
        return []


class Mat5File(ArrayFile):
    """Variables of MATLAB before 7.3, each read whole when it is asked for.

    Args:
        name: Path of the file, for messages.
        file: The open file.

    Raises:
        DataError: It is no .mat, or too large.
        ConfigError: scipy is not installed.
    """

    fix = "save it again"

    def __init__(self, name: str, file: Slice) -> None:
        super().__init__(name)
        self._scipy, self._file = need("scipy.io", name), file
        self._values: dict[str, Any] = {}
        check_mat5(name, file)
        try:
            found = self._scipy.whosmat(file)
        except Exception as error:  # scipy fails in its own ways at damage
            line = " ".join(str(error).split())
            raise DataError(f"{name}: not a readable .mat ({line}); save it again") from error
        # of 8 bytes each: headers of classes without a size, structs and cells, are small
        if (size := sum(prod(shape) * 8 for _, shape, kind in found if kind == "double")) > _MOST:
            raise DataError(f"{name}: {size >> 20} MB at once; save it with -v7.3, or as npz")
        # scipy believes the places of sparse values, and no touch is sparse
        self._known = [variable for variable, _, kind in found if kind != "sparse"]

    def _list(self) -> list[str]:
        check_keys(self.name, len(self._known))
        for variable in self._known:
            self._values |= _fields(self._load(variable), variable)
        count = _rows_of([array.shape for array in self._values.values()])
        for key, array in self._values.items():
            if _is_last(array.shape, count):
                self._values[key] = np.moveaxis(array, -1, 0)
        return [*self._values]

    def _load(self, variable: str) -> Any:
        self._file.seek(0)
        try:
            content = self._scipy.loadmat(
                self._file, variable_names=[variable], simplify_cells=True
            )
        except Exception as error:  # as above
            raise self._wrong(variable, " ".join(str(error).split())) from error
        return content.get(variable)

    def _look(self, key: str) -> Facts:
        self.keys()
        array = self._values[key]
        if array.dtype.names or array.dtype.kind not in "biufSU":
            raise self._wrong(key, f"of type {array.dtype}")
        return Facts(array.shape, array.dtype, max(1, len(array)) if array.ndim else 1)

    def _rows(self, key: str, facts: Facts, start: int, stop: int) -> NDArray[Any]:
        array: NDArray[Any] = self._values[key]
        return array[start:stop] if array.ndim else array


def _rows_of(shapes: Sequence[tuple[int, ...]]) -> int:
    """Length of most vectors, 0 without any: the number of frames or rows."""
    lengths = Counter(shape[0] for shape in shapes if len(shape) == 1)
    return lengths.most_common(1)[0][0] if lengths else 0


def _is_last(shape: tuple[int, ...], count: int) -> bool:
    """Whether time is the last axis, as MATLAB's pictures have it: (H, W, 3, T)."""
    if len(shape) == 4 and shape[2] in (1, 3) and shape[3] not in (1, 3):
        return True
    return len(shape) > 1 and shape[-1] == count > 0 and shape[0] != count


def _without_ones(shape: tuple[int, ...]) -> tuple[int, ...]:
    """Sizes of a vector or number of MATLAB, without axes of one."""
    if len(shape) == 2 and 1 in shape:
        return (prod(shape),) if prod(shape) > 1 else ()
    return shape


def _fields(value: Any, name: str) -> dict[str, NDArray[Any]]:
    """Arrays of a variable, and of the fields of a struct; lists and cells are left out."""
    if isinstance(value, Mapping):
        out: dict[str, NDArray[Any]] = {}
        for field, inner in value.items():
            out |= _fields(inner, f"{name}/{field}")
        return out
    array = np.asarray(value)
    return {name: array} if array.dtype.kind in "biufSU" else {}
