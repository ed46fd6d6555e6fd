"""HDF5 files, alone or in an archive."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from importlib import import_module
from importlib.util import find_spec
from itertools import product
from math import prod
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from tactileforge.errors import DataError
from tactileforge.reading import DEEPEST, MOST_TEXT, Facts, check_keys, check_size
from tactileforge_episodes.arrays import ArrayFile, check_lost
from tactileforge_episodes.hdf_chunks import Chunks
from tactileforge_episodes.members import DAMAGED
from tactileforge_episodes.packages import need
from tactileforge_episodes.slices import Slice

if TYPE_CHECKING:
    from h5py import Dataset

#: Package of filters that h5py does not bring.
_FILTERS = "hdf5plugin"


class HdfFile(ArrayFile):
    """Data sets of an HDF5 file. Links to other files are not followed.

    Args:
        name: Path of the file, for messages.
        file: The open file.

    Raises:
        DataError: It is not an HDF5 file.
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
        self._chunks: dict[str, Chunks] = {}
        self._count, self._listed = 0, set[str]()

    def _list(self) -> list[str]:
        self._count = 0
        self._again = list[str]()
        try:  # a group with several names is listed by its first
            found = [*self._below("", 0, {})]
        except DAMAGED as error:
            raise DataError(f"{self.name}: damaged ({error}); download it again") from error
        if again := self._again:
            more = (
                f"; {len(again) - 1} further names of groups are left out so" if again[1:] else ""
            )
            self.left[f"{self.name}, {again[0]}{more}"] = None
        return found

    def _below(self, group: str, depth: int, seen: dict[int, str]) -> Iterator[str]:
        h5py = self._h5py
        node = self._file[group] if group else self._file
        address = h5py.h5o.get_info(node.id).addr
        if address in seen:
            self._again.append(f"{group}: the same group as {seen[address] or '/'}")
            return
        seen[address] = group
        if depth > DEEPEST:
            self.left[f"{self.name}, {group}: more than {DEEPEST} groups in each other"] = None
            return
        self._count += len(node)
        check_keys(self.name, self._count)
        for name in node:
            path = f"{group}/{name}" if group else name
            link = node.get(name, getlink=True)
            if not isinstance(link, h5py.HardLink):
                outside = isinstance(link, h5py.ExternalLink)
                where = "to another file" if outside else f"to {link.path}"
                self.left[f"{self.name}, {path}: a link {where}, which is not followed"] = None
                continue
            kind = node.get(name, getclass=True)
            if issubclass(kind, h5py.Dataset):
                self._listed.add(path)
                yield path
            elif issubclass(kind, h5py.Group):
                yield from self._below(path, depth + 1, seen)

    def _look(self, key: str) -> Facts:
        h5py = self._h5py
        self._check_links(key)
        found = self._file[key]
        if not isinstance(found, h5py.Dataset):
            raise self._wrong(key, "a group, no array")
        if found.external or found.is_virtual:
            raise self._wrong(key, "its values lie in another file, which is not opened")
        self._check_filters(key, found)
        dtype = np.dtype(object) if found.dtype.hasobject else found.dtype
        if names := found.dtype.names:
            raise DataError(
                f"{self.name}, {key}: a table of {', '.join(names[:8])}, which is not read; write "
                "each column as an array of its own"
            )
        if dtype.kind not in "biufSUO":
            raise self._wrong(key, f"of type {found.dtype}")
        if found.shape is None:
            raise self._wrong(key, "an array without values")
        if why := check_size("chunks", found.shape, dtype, found.chunks or ()):
            raise self._wrong(key, why)
        self._sets[key] = found
        return Facts(found.shape, dtype, found.chunks[0] if found.chunks else 1)

    def _check_links(self, key: str) -> None:
        if key in self._listed:
            return
        names = key.strip("/").split("/")
        for depth in range(len(names)):
            link = self._file.get("/".join(names[: depth + 1]), getlink=True)
            if isinstance(link, self._h5py.ExternalLink):
                raise self._wrong(key, "a link to another file, which is not followed")

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

    def check_chunks(self, key: str, start: int, stop: int) -> None:
        """Looks at the chunks of some rows before they are unpacked; see `Chunks.check`."""
        found = self._sets[key]
        if found.chunks is not None:
            if key not in self._chunks:
                self._chunks[key] = Chunks(f"{self.name}, {key}", found)
            self._chunks[key].check(start, stop)

    def _rows(self, key: str, facts: Facts, start: int, stop: int) -> NDArray[Any]:
        self.check_chunks(key, start, stop)
        values = self._sets[key][start:stop] if facts.shape else self._sets[key][()]
        if facts.shape or facts.dtype.kind != "O":
            return np.asarray(values)
        single = np.empty((), object)
        single[()] = values
        return single

    def lost(self, key: str, start: int, stop: int) -> list[int]:
        """Rows of a range without stored values; see `ArrayFile.lost`."""
        facts, found = self.facts(key), self._sets[key]
        stop = min(stop, facts.rows)
        if not facts.shape or not all(facts.shape):
            return []
        if found.chunks is None:
            if found.id.get_storage_size():
                return []
            check_lost(f"{self.name}, {key}", stop - start)
            return list(range(start, stop))
        counts = [-(-size // step) for size, step in zip(found.shape, found.chunks, strict=True)]
        with self.naming(key):
            if found.id.get_num_chunks() == prod(counts):
                return []
            step, out = found.chunks[0], list[int]()
            check_lost(f"{self.name}, {key}", stop // step - start // step)
            for row in range(start // step, -(-stop // step)):
                if not all(self._stored(found, (row, *rest)) for rest in _cells(counts[1:])):
                    rows = range(max(start, row * step), min(stop, (row + 1) * step))
                    check_lost(f"{self.name}, {key}", len(out) + len(rows))
                    out += rows
            return out

    def _stored(self, found: Dataset, place: Sequence[int]) -> bool:
        corner = tuple(i * step for i, step in zip(place, found.chunks, strict=True))
        return found.id.get_chunk_info_by_coord(corner).byte_offset is not None

    def is_void(self, key: str) -> bool:
        """Whether no value of an array was ever written."""
        facts = self.facts(key)
        return all(facts.shape) and not self._sets[key].id.get_storage_size()

    def attribute(self, key: str, name: str) -> Any:
        """An attribute of a data set or group; None where there is none."""
        with self.naming(key, f"attribute {name}: "):
            if key.strip("/"):
                self._check_links(key)
            if key.strip("/") and key not in self._file:
                return None
            node = self._file[key] if key.strip("/") else self._file
            if name not in node.attrs:
                return None
            about = node.attrs.get_id(name)
            if prod(about.shape or (0,)) * about.dtype.itemsize > MOST_TEXT:
                raise self._wrong(key, f"attribute {name} of more than {MOST_TEXT} bytes")
            return node.attrs.get(name)


def _cells(counts: Sequence[int]) -> Iterator[tuple[int, ...]]:
    return product(*map(range, counts))
