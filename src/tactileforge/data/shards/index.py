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
from tactileforge.util.files import sealed, sha256, unsealed, write_text
from tactileforge.util.untrusted import load_json

#: Name of the file.
INDEX_FILE = "index.json"
#: Version of its layout; readers refuse other versions.
VERSION = 4
#: Names of shards: never a path, so that an index cannot point elsewhere.
_FILE = re.compile(r"[A-Za-z0-9_][\w.\-]*\.tar")


@dataclass(frozen=True)
class IndexEntry:
    """Row of one shard.

    Attributes:
        file: Name of the shard in the folder.
        bytes: Size of the shard.
        sha256: SHA-256 of the shard, hexadecimal.
        first: Smallest `sort_key` of its recordings.
        last: Largest `sort_key` of its recordings.
        summary: Counts of its recordings.
    """

    file: str
    bytes: int
    sha256: str
    first: str
    last: str
    summary: Summary

    @classmethod
    def of(cls, path: Path) -> IndexEntry:
        """Read a shard and build its row.

        Raises:
            DataError: The shard is damaged, or two of its recordings have one key.
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
        """The row as plain data; see `from_json`."""
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
        """Build a row from plain data of `to_json`.

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
        name: Name of the data set.
        splits: Shards of ``train`` and ``val``.
        sorted: Whether recordings lie in the order of `sort_key`, without overlapping shards.
        made: Provenance of the shards, as plain data.
        statistics: Statistics of each split by `data pack`, as plain data.
    """

    name: str
    splits: dict[str, list[IndexEntry]]
    sorted: bool = False
    made: dict[str, Any] = field(default_factory=dict)
    statistics: dict[str, Any] = field(default_factory=dict)

    def save(self, folder: Path) -> None:
        """Write ``index.json``: beside its place, then renamed."""
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
        write_text(folder / INDEX_FILE, sealed(text))


def parse_index(text: str | bytes, where: str) -> Index:
    """Parse the text of an ``index.json``.

    Args:
        text: Text of the file.
        where: Name of the text, for messages.

    Raises:
        DataError: The text is not an index, is damaged or of another version, or two shards hold
            the same recordings.
    """
    try:
        # the version before the seal, which other versions may write in another way
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
    # before a recording is read twice in each pass, as if it were two
    for entries in index.splits.values():
        ordered = sorted((e for e in entries if e.first), key=lambda e: (e.first, e.last))
        for entry, other in pairwise(ordered):
            overlaps = index.sorted and other.first <= entry.last
            if overlaps or entry.sha256 == other.sha256 or entry.file == other.file:
                raise DataError(
                    f"{where}: {entry.file} and {other.file} hold recordings of one key; remove "
                    "one of them and pack again"
                )
    return index


def sort_key(object: str | None, key: str) -> str:
    """Sort key of recordings, 32 hexadecimal digits.

    Touches of one object stand together, and the order of objects is random: a part of the whole is
    a fair sample of it, and pairs lie in one shard.
    """
    whole = object if object is not None else key
    return _digest(whole) + _digest(key)


def sort_recordings(recordings: Iterable[Recording]) -> list[Recording]:
    """Sort recordings by `sort_key`."""
    return sorted(recordings, key=lambda recording: sort_key(recording.object, recording.key))


def _digest(text: str) -> str:
    return hashlib.blake2b(text.encode("utf-8", "surrogatepass"), digest_size=8).hexdigest()
