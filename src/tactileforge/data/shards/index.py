"""The index of a folder of shards: ``index.json``, one row a shard (`docs/shards.md`)."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Any

from tactileforge.contracts import Recording
from tactileforge.data.shards import shards
from tactileforge.data.shards.summary import Summary
from tactileforge.errors import DataError
from tactileforge.files import sealed, sha256, unsealed, write_text
from tactileforge.untrusted import load_json

#: Name of the file.
NAME = "index.json"
#: Version of its layout; a reader refuses another.
VERSION = 4
#: What a shard may be called: never a path, so that an index cannot point elsewhere.
_FILE = re.compile(r"[A-Za-z0-9_][\w.\-]*\.tar")


@dataclass(frozen=True)
class IndexEntry:
    """One shard.

    Attributes:
        file: Its name in the folder.
        bytes: Its size.
        sha256: Its checksum.
        first: Smallest `sort_key` of its recordings.
        last: Largest `sort_key` of its recordings.
        summary: What it holds.
    """

    file: str
    bytes: int
    sha256: str
    first: str
    last: str
    summary: Summary

    @classmethod
    def of(cls, path: Path) -> IndexEntry:
        """Reads a shard and sums it up.

        Raises:
            DataError: It is damaged, or two of its recordings have one key.
        """
        summary, places = Summary(), []
        for recording in shards.read_shard(path):
            summary.add(recording)
            places.append((sort_key(recording.object, recording.key), recording.key))
        keys = [key for _, key in places]
        if len(set(keys)) < len(keys):
            twice = next(key for key in keys if keys.count(key) > 1)
            raise DataError(f"{path}: two recordings are called {twice!r}; give each its own key")
        first = min(places)[0] if places else ""
        last = max(places)[0] if places else ""
        return cls(path.name, path.stat().st_size, sha256(path), first, last, summary)

    def to_json(self) -> dict[str, Any]:
        """As plain data; see `from_json`."""
        return {
            "file": self.file,
            "bytes": self.bytes,
            "sha256": self.sha256,
            "first": self.first,
            "last": self.last,
            "holds": self.summary.to_json(),
        }

    @classmethod
    def from_json(cls, row: Mapping[str, Any]) -> IndexEntry:
        """The entry that `to_json` wrote.

        Raises:
            KeyError: A value is missing.
            TypeError: A value is of the wrong type.
            ValueError: The file's name is a path.
        """
        if not _FILE.fullmatch(row["file"]):
            raise ValueError(f"{row['file']!r} is not the name of a shard")
        holds = Summary.from_json(row["holds"])
        return cls(row["file"], int(row["bytes"]), row["sha256"], row["first"], row["last"], holds)


@dataclass(frozen=True)
class Index:
    """All shards of a folder.

    Attributes:
        name: Of the data set.
        splits: Shards of ``train`` and ``val``.
        sorted: Whether recordings lie in the order of `sort_key`, so that shards do not overlap.
        made: How they were made, as plain data.
        statistics: Of each split, as plain data; what `data pack` found while it read.
    """

    name: str
    splits: dict[str, list[IndexEntry]]
    sorted: bool = False
    made: dict[str, Any] = field(default_factory=dict)
    statistics: dict[str, Any] = field(default_factory=dict)

    def save(self, folder: Path) -> None:
        """Writes ``index.json``: beside its place, then renamed."""
        text = {
            "version": VERSION,
            "name": self.name,
            "sorted": self.sorted,
            "splits": {
                split: [entry.to_json() for entry in entries]
                for split, entries in self.splits.items()
            },
            "made": self.made,
            "statistics": self.statistics,
        }
        write_text(folder / NAME, sealed(text))


def parse_index(text: str | bytes, where: str) -> Index:
    """Reads the text of an ``index.json``.

    Args:
        text: The text.
        where: Where it comes from, for messages.

    Raises:
        DataError: It is no index, is damaged or of another version, or two shards hold the same
            recordings.
    """
    try:
        version = load_json(text)["version"]
        if version != VERSION:
            raise DataError(
                f"{where}: version {version}, but this tactileforge reads {VERSION}; pack the data "
                "again, or remove the file to read the shards without it"
            )
        plain = unsealed(text)
        splits = {
            str(split): [IndexEntry.from_json(row) for row in rows]
            for split, rows in plain["splits"].items()
        }
        index = Index(
            name=str(plain["name"]),
            splits=splits,
            sorted=bool(plain["sorted"]),
            made=dict(plain["made"]),
            statistics=dict(plain["statistics"]),
        )
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise DataError(f"{where}: no index of shards ({error!r}); pack the data again") from error
    _check_apart(index, where)
    return index


def _check_apart(index: Index, where: str) -> None:
    for entries in index.splits.values():
        ordered = sorted((e for e in entries if e.first), key=lambda e: (e.first, e.last))
        for entry, other in pairwise(ordered):
            overlaps = index.sorted and other.first <= entry.last
            if overlaps or entry.sha256 == other.sha256 or entry.file == other.file:
                raise DataError(
                    f"{where}: {entry.file} and {other.file} hold recordings of one key; remove "
                    "one of them and pack again"
                )


def sort_key(object: str | None, key: str) -> str:
    """Key by which recordings are ordered, 32 hexadecimal digits.

    What one object felt stands together, and objects stand in an order that says nothing about
    them: a part of the whole is a fair sample of it, and pairs lie in one shard.
    """
    whole = object if object is not None else key
    return _digest(whole) + _digest(key)


def sort_recordings(recordings: Iterable[Recording]) -> list[Recording]:
    """Recordings in the order of `sort_key`."""
    return sorted(recordings, key=lambda recording: sort_key(recording.object, recording.key))


def _digest(text: str) -> str:
    return hashlib.blake2b(text.encode("utf-8", "surrogatepass"), digest_size=8).hexdigest()
