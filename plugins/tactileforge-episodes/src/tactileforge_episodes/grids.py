"""Chunks of an array of zarr: their names, and those stored."""

from __future__ import annotations

import posixpath
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from math import prod
from typing import Any

from tactileforge.reading import check_keys
from tactileforge_episodes.arrays import check_lost
from tactileforge_episodes.members import Members


@dataclass(frozen=True)
class Grid:
    """Chunks of an array, or its shards, by their files.

    Attributes:
        folder: Folder of the array.
        shape: Sizes of the array.
        chunks: Sizes of a file's values.
        start: Begin of each name: ``c`` and the mark in version 3.
        mark: Character between numbers.
    """

    folder: str
    shape: tuple[int, ...]
    chunks: tuple[int, ...]
    start: str
    mark: str

    @classmethod
    def of(cls, folder: str, key: str, version: int, about: Mapping[str, Any]) -> Grid:
        """The grid of a description.

        Args:
            folder: Folder of the group.
            key: Path of the array in it.
            version: Version of zarr, 2 or 3.
            about: The array's ``.zarray`` or ``zarr.json``.
        """
        place, start = posixpath.join(folder, key), ""
        if version == 2:
            chunks, mark = about["chunks"], about.get("dimension_separator") or "."
        else:
            chunks = about["chunk_grid"]["configuration"]["chunk_shape"]
            coded = about.get("chunk_key_encoding") or {}
            default = coded.get("name", "default") == "default"
            mark = (coded.get("configuration") or {}).get("separator", "/" if default else ".")
            start = f"c{mark}" if default else ""
        return cls(place, tuple(about["shape"]), tuple(chunks), start, mark)

    @cached_property
    def _rests(self) -> list[str]:
        """Ends of the names of the chunks of one row of them, behind its number."""
        counts = [-(-size // step) for size, step in zip(self.shape, self.chunks, strict=True)]
        check_keys(self.folder, prod(counts[1:]))
        inner = product(*map(range, counts[1:]))
        return ["".join(f"{self.mark}{number}" for number in rest) for rest in inner]

    def lost(self, members: Members, start: int, stop: int) -> list[int]:
        """Rows in a range without a stored chunk.

        Args:
            members: Files of the group.
            start: First row.
            stop: Row after the last.

        Raises:
            DataError: A row has more chunks than anyone writes, or more is lost than anyone loses.
        """
        if not self.shape:
            name = self.start.rstrip(self.mark) or "0"
            return [] if members.has(posixpath.join(self.folder, name)) else [0]
        if not all(self.shape):
            return []
        step, rests = self.chunks[0], self._rests
        flat = members.files(self.folder) if self.mark != "/" else None
        out: list[int] = []
        check_lost(self.folder, stop // step - start // step)
        for row in range(start // step, -(-stop // step)):
            for rest in rests:
                name = f"{self.start}{row}{rest}"
                there = name in flat if flat is not None else members.has(f"{self.folder}/{name}")
                if not there:
                    rows = range(max(start, row * step), min(stop, (row + 1) * step))
                    check_lost(self.folder, len(out) + len(rows))
                    out += rows
                    break
        return out

    def any(self, members: Members) -> bool:
        """Whether a chunk is stored.

        Args:
            members: Files of the group.
        """
        folders, files = members.children(self.folder)
        if self.mark == "/" and folders:
            return True
        return any(name[0] != "." and name != "zarr.json" for name in files)
