"""Zarr groups, versions 2 and 3, in a folder or an archive."""

from __future__ import annotations

import posixpath
from collections.abc import AsyncIterator, Iterable, Iterator
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from tactileforge.plugins import load_json
from tactileforge_episodes.arrays import Container, Facts, is_sane
from tactileforge_episodes.codecs import blosc_of, check_blosc, check_codecs
from tactileforge_episodes.members import Members
from tactileforge_episodes.packages import need

if TYPE_CHECKING:
    from zarr import Array

#: Files with the description of an array (zarr 2) and of an array or group (zarr 3).
ARRAY_2, NODE_3 = ".zarray", "zarr.json"


class ZarrFile(Container):
    """Arrays of a zarr group.

    Args:
        name: Path of the group, for messages.
        members: Files of the folder or archive.
        folder: Folder of the group in it, "" for the top.
    """

    def __init__(self, name: str, members: Members, folder: str) -> None:
        super().__init__(name)
        self.members, self.folder = members, folder
        self._arrays: dict[str, Array[Any]] = {}

    def keys(self) -> list[str]:
        """Paths of the arrays, in order; folders of chunks are not listed."""
        return sorted(self._below(""))

    def _below(self, group: str) -> Iterator[str]:
        folders, _ = self.members.children(posixpath.join(self.folder, group))
        for name in folders:
            path = posixpath.join(group, name)
            if self._described(path) is None:
                yield from self._below(path)
            else:
                yield path

    def _described(self, key: str) -> tuple[int, dict[str, Any]] | None:
        """Version and description of an array; None for a group, or any other folder."""
        for version, file in ((2, ARRAY_2), (3, NODE_3)):
            raw = self.members.read(posixpath.join(self.folder, key, file))
            if raw is None:
                continue
            try:
                about = load_json(raw)
            except ValueError as error:
                raise self._wrong(key, f"{file} is no JSON: {error}") from error
            if not isinstance(about, dict):
                raise self._wrong(key, f"{file} holds no names and values")
            if version == 2 or about.get("node_type") == "array":
                return version, about
        return None

    def _look(self, key: str) -> Facts:
        found = self._described(key)
        if found is None:
            raise self._wrong(key, "no such array")
        version, about = found
        check_codecs(f"{self.name}, {key}", about)
        zarr = need("zarr", self.name)
        array = zarr.open_array(
            _store_type()(self.members, self.name, blosc_of(about)),
            path=posixpath.join(self.folder, key),
            mode="r",
            zarr_format=version,
        )
        dtype = np.dtype(array.dtype)
        if not is_sane(array.shape, dtype) or not is_sane(array.chunks, dtype, 1 << 32):
            raise self._wrong(key, f"shape {array.shape} in chunks of {array.chunks}")
        self._arrays[key] = array
        # of a shard, its inner chunks are decoded alone
        rows = int(array.chunks[0]) if array.ndim else 1
        return Facts(tuple(map(int, array.shape)), dtype, rows)

    def _rows(self, key: str, facts: Facts, start: int, stop: int) -> NDArray[Any]:
        array = self._arrays[key]
        values = np.asarray(array[start:stop] if facts.shape else array[()])
        if facts.dtype == np.uint8 and values.ndim > 2 and not values.any():
            self._check_present(key, start)
        return values

    def _check_present(self, key: str, row: int) -> None:
        """Raises a `DataError` if the chunk of black pictures is missing, and not black."""
        found = self._described(key)
        if found is None or "storage_transformers" in found[1] or found[0] == 3:
            return
        chunks, axes = found[1]["chunks"], len(found[1]["shape"])
        mark = found[1].get("dimension_separator") or "."
        name = mark.join([str(row // int(chunks[0])), *["0"] * (axes - 1)])
        if self.members.read(posixpath.join(self.folder, key, name), 0, 1) is None:
            raise self._wrong(key, f"chunk {name} with row {row} is missing")

    def attribute(self, key: str, name: str) -> Any:
        """An attribute of an array or group; None where there is none."""
        for file in (".zattrs", NODE_3):
            raw = self.members.read(posixpath.join(self.folder, key, file))
            if raw is not None:
                try:
                    about = load_json(raw)
                except ValueError as error:
                    raise self._wrong(key, f"{file} is no JSON: {error}") from error
                values = about.get("attributes", {}) if file == NODE_3 else about
                return values.get(name) if isinstance(values, dict) else None
        return None


@cache
def _store_type() -> type[Any]:
    """The class of stores, made late: zarr takes a second to import."""
    from zarr.abc.store import (
        ByteRequest,
        OffsetByteRequest,
        RangeByteRequest,
        Store,
        SuffixByteRequest,
    )
    from zarr.core.buffer import Buffer, BufferPrototype

    class MemberStore(Store):
        """Members of a folder or archive as a read-only store of zarr."""

        supports_writes = False
        supports_deletes = False
        supports_listing = False

        def __init__(self, members: Members, name: str, blosc: str) -> None:
            super().__init__(read_only=True)
            self.members, self.name, self.blosc = members, name, blosc

        def __eq__(self, other: object) -> bool:
            return self is other

        async def get(
            self, key: str, prototype: BufferPrototype, byte_range: ByteRequest | None = None
        ) -> Buffer | None:
            """Bytes of a member."""
            start, stop = 0, None
            if isinstance(byte_range, RangeByteRequest):
                start, stop = byte_range.start, byte_range.end
            elif isinstance(byte_range, OffsetByteRequest):
                start = byte_range.offset
            elif isinstance(byte_range, SuffixByteRequest):
                start = -byte_range.suffix
            content = self.members.read(key, start, stop)
            whole = byte_range is None and not key.endswith((ARRAY_2, NODE_3, ".zattrs"))
            part = isinstance(byte_range, RangeByteRequest)
            if content is not None and {"chunk": whole, "part": part}.get(self.blosc):
                check_blosc(f"{self.name}, {key}", content)
            return None if content is None else prototype.buffer.from_bytes(content)

        async def get_partial_values(
            self,
            prototype: BufferPrototype,
            key_ranges: Iterable[tuple[str, ByteRequest | None]],
        ) -> list[Buffer | None]:
            """Bytes of parts of members."""
            return [await self.get(key, prototype, part) for key, part in key_ranges]

        async def exists(self, key: str) -> bool:
            """Whether there is a member of this name."""
            return self.members.read(key, 0, 1) is not None

        async def set(self, key: str, value: Buffer) -> None:
            """Refuses: the store is read only."""
            raise NotImplementedError

        async def delete(self, key: str) -> None:
            """Refuses: the store is read only."""
            raise NotImplementedError

        def list(self) -> AsyncIterator[str]:
            """Refuses: keys are listed by `ZarrFile.keys`."""
            raise NotImplementedError

        def list_prefix(self, prefix: str) -> AsyncIterator[str]:
            """Refuses: keys are listed by `ZarrFile.keys`."""
            raise NotImplementedError

        def list_dir(self, prefix: str) -> AsyncIterator[str]:
            """Refuses: keys are listed by `ZarrFile.keys`."""
            raise NotImplementedError

    return MemberStore
