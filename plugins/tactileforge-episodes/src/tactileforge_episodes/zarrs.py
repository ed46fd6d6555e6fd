"""Zarr groups, versions 2 and 3, in a folder or an archive."""

from __future__ import annotations

import posixpath
from collections.abc import AsyncIterator, Iterable, Iterator, Mapping
from functools import cache
from math import prod
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from tactileforge.plugins import load_json
from tactileforge.reading import DEEPEST, MOST_TEXT, Facts, check_keys, check_size
from tactileforge_episodes.arrays import ArrayFile
from tactileforge_episodes.codecs import check_codecs
from tactileforge_episodes.grids import Grid
from tactileforge_episodes.guards import Guard, guard_of
from tactileforge_episodes.members import Members
from tactileforge_episodes.packages import need

if TYPE_CHECKING:
    from zarr import Array

#: Files with the description of an array (zarr 2) and of an array or group (zarr 3).
ARRAY_2, NODE_3 = ".zarray", "zarr.json"


class ZarrFile(ArrayFile):
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
        self._grids: dict[str, Grid] = {}

    def _list(self) -> list[str]:
        found = [*self._below("", 0, [0])]
        self.left |= self.members.left
        return found

    def _below(self, group: str, depth: int, seen: list[int]) -> Iterator[str]:
        if depth > DEEPEST:
            self.left[f"{self.name}, {group}: more than {DEEPEST} groups in each other"] = None
            return
        folders, _ = self.members.children(posixpath.join(self.folder, group))
        for name in folders:
            seen[0] += 1
            check_keys(self.name, seen[0])
            path = posixpath.join(group, name)
            if self._described(path) is None:
                yield from self._below(path, depth + 1, seen)
            else:
                yield path

    def _described(self, key: str) -> tuple[int, dict[str, Any]] | None:
        """Version and description of an array; None for a group, or any other folder."""
        for version, file in ((2, ARRAY_2), (3, NODE_3)):
            about = self._json(key, file)
            if about is None:
                continue
            if not isinstance(about, dict):
                raise self._wrong(key, f"{file} holds no names and values")
            if version == 2 or about.get("node_type") == "array":
                return version, about
        return None

    def _json(self, key: str, file: str) -> Any:
        """Content of a file of an array or group; None without it."""
        raw = self.members.read(posixpath.join(self.folder, key, file), 0, MOST_TEXT + 1)
        if raw is None:
            return None
        if len(raw) > MOST_TEXT:
            raise self._wrong(key, f"{file} has more than {MOST_TEXT} bytes")
        try:
            return load_json(raw)
        except ValueError as error:
            raise self._wrong(key, f"{file} is not JSON: {error}") from error

    def _look(self, key: str) -> Facts:
        found = self._described(key)
        if found is None:
            raise self._wrong(key, "no such array")
        version, about = found
        check_codecs(f"{self.name}, {key}", about)
        self._check_sizes(key, about)
        zarr = need("zarr", self.name)
        store = _store_type()(self.members, self.name)
        path = posixpath.join(self.folder, key)
        array = zarr.open_array(store, path=path, mode="r", zarr_format=version)
        dtype = np.dtype(array.dtype)
        if why := check_size("chunks", array.shape, dtype, array.chunks):
            raise self._wrong(key, why)
        store.guard = guard_of(about, dtype.itemsize * prod(array.chunks), dtype.hasobject)
        self._arrays[key], self._grids[key] = array, Grid.of(self.folder, key, version, about)
        # of a shard, its inner chunks are decoded alone
        rows = int(array.chunks[0]) if array.ndim else 1
        return Facts(tuple(map(int, array.shape)), dtype, rows)

    def _check_sizes(self, key: str, about: Mapping[str, Any]) -> None:
        """Raises a `DataError` for sizes beyond zarr's own limits."""
        if "chunk_grid" in about:
            if (kind := about["chunk_grid"].get("name")) != "regular":
                raise self._wrong(
                    key, f"chunk grid {str(kind)[:40]!r}, where regular ones are read"
                )
            chunks = about["chunk_grid"]["configuration"]["chunk_shape"]
        else:
            chunks = about["chunks"]
        for sizes, least in ((about["shape"], 0), (chunks, 1)):
            if not isinstance(sizes, list) or not all(
                type(one) is int and least <= one < 1 << 62 for one in sizes
            ):
                raise self._wrong(
                    key, f"shape {str(about['shape'])[:60]} in chunks of {chunks!r:.60}"
                )
        if len(chunks) != len(about["shape"]):
            raise self._wrong(key, f"shape {about['shape']} in chunks of {chunks}")

    def _rows(self, key: str, facts: Facts, start: int, stop: int) -> NDArray[Any]:
        array = self._arrays[key]
        return np.asarray(array[start:stop] if facts.shape else array[()])

    def lost(self, key: str, start: int, stop: int) -> list[int]:
        """Rows in a range without a stored chunk; see `ArrayFile.lost`."""
        facts = self.facts(key)
        return self._grids[key].lost(self.members, start, min(stop, facts.rows))

    def is_void(self, key: str) -> bool:
        """Whether no chunk of an array is stored; zarr leaves out those of its fill value."""
        grid = self._grids[key] if self.facts(key).rows else None
        return grid is not None and not grid.any(self.members)

    def attribute(self, key: str, name: str) -> Any:
        """An attribute of an array or group; None where there is none."""
        for file in (".zattrs", NODE_3):
            about = self._json(key, file)
            if isinstance(about, dict):
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

        def __init__(self, members: Members, name: str) -> None:
            super().__init__(read_only=True)
            self.members, self.name, self.guard = members, name, Guard()

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
            if content is not None and {"chunk": whole, "part": part}.get(self.guard.where):
                self.guard.check(f"{self.name}, {key}", content)
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
