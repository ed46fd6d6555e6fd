"""HDF5 files, alone or in an archive."""

from __future__ import annotations

from collections.abc import Iterator
from importlib import import_module
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from tactileforge.errors import DataError
from tactileforge_episodes.arrays import Container, Facts, is_sane
from tactileforge_episodes.members import DAMAGED
from tactileforge_episodes.packages import need
from tactileforge_episodes.slices import Slice

if TYPE_CHECKING:
    from h5py import Dataset

#: Package of filters that h5py does not bring.
_FILTERS = "hdf5plugin"
#: Deepest group that is looked into.
_DEPTH = 12


class HdfFile(Container):
    """Data sets of an HDF5 file. Links to other files are not followed.

    Args:
        name: Path of the file, for messages.
        file: The open file.

    Raises:
        DataError: It is no HDF5 file.
    """

    fix = "correct or replace the file"

    def __init__(self, name: str, file: Slice) -> None:
        super().__init__(name)
        h5py = self._h5py = need("h5py", name)
        try:
            self._file = h5py.File(file, "r")
        except DAMAGED as error:
            raise DataError(f"{name}: not a readable HDF5 file ({error}); download it again") from (
                error
            )
        self._sets: dict[str, Dataset] = {}

    def keys(self) -> list[str]:
        """Paths of the data sets, in order."""
        try:
            return sorted(self._below("", 0))
        except DAMAGED as error:
            raise DataError(f"{self.name}: damaged ({error}); download it again") from error

    def _below(self, group: str, depth: int) -> Iterator[str]:
        h5py = self._h5py
        node = self._file[group] if group else self._file
        for name in node:
            path = f"{group}/{name}" if group else name
            if not isinstance(node.get(name, getlink=True), h5py.HardLink):
                continue
            if issubclass(node.get(name, getclass=True), h5py.Dataset):
                yield path
            elif depth < _DEPTH:
                yield from self._below(path, depth + 1)

    def _look(self, key: str) -> Facts:
        h5py = self._h5py
        names = key.strip("/").split("/")
        for depth in range(len(names)):
            link = self._file.get("/".join(names[: depth + 1]), getlink=True)
            if isinstance(link, h5py.ExternalLink):
                raise self._wrong(key, "a link to another file, which is not followed")
        found = self._file[key]
        if not isinstance(found, h5py.Dataset):
            raise self._wrong(key, "a group, no array")
        if found.external or found.is_virtual:
            raise self._wrong(key, "its values lie in another file, which is not opened")
        self._check_filters(key, found)
        dtype = np.dtype(object) if found.dtype.hasobject else found.dtype
        if found.dtype.names or dtype.kind not in "biufSUO":
            raise self._wrong(key, f"of type {found.dtype}")
        if not is_sane(found.shape, dtype) or not is_sane(found.chunks or (), dtype, 1 << 32):
            raise self._wrong(key, f"shape {found.shape} in chunks of {found.chunks}")
        self._sets[key] = found
        return Facts(found.shape, dtype, found.chunks[0] if found.chunks else 1)

    def _check_filters(self, key: str, found: Dataset) -> None:
        h5py = self._h5py
        about = found.id.get_create_plist()
        for i in range(about.get_nfilters()):
            number, _, _, title = about.get_filter(i)
            if not h5py.h5z.filter_avail(number) and find_spec(_FILTERS):
                import_module(_FILTERS)
            if not h5py.h5z.filter_avail(number):
                raise DataError(
                    f"{self.name}, {key}: its filter {title.decode('utf-8', 'replace')!r} (number "
                    f"{number}) is not installed: pip install {_FILTERS}"
                )

    def _rows(self, key: str, facts: Facts, start: int, stop: int) -> NDArray[Any]:
        values = self._sets[key][start:stop] if facts.shape else self._sets[key][()]
        if facts.shape or facts.dtype.kind != "O":
            return np.asarray(values)
        single = np.empty((), object)
        single[()] = values
        return single

    def attribute(self, key: str, name: str) -> Any:
        """An attribute of a data set or group; None where there is none."""
        with self._naming(key, f"attribute {name}: "):
            node = self._file[key] if key.strip("/") else self._file
            return node.attrs.get(name)
