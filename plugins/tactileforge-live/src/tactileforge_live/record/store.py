"""The folder of a recording: segments, durable once written, joined into one shard per take.

A segment is written beside its place, synced to the disk and renamed, and then the index in the
same way. The order matters: every acknowledged segment is in the index, and the index lists only
complete files. Files left by a killed run are cleaned up when the folder is opened again.
"""

from __future__ import annotations

import os
import re
import shutil
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Self

from tactileforge.data import INDEX_FILE, Index, IndexEntry, Packed, parse_index, write_shard
from tactileforge.errors import DataError
from tactileforge.plugins import locked, refuse_shards
from tactileforge_live.record.merge_segments import merge_segments
from tactileforge_live.record.raw import Raw, append_raw, merge_raw

#: Folder of incomplete files, beside the shards.
NOTES = ".record"
#: Name of the index's author, to recognise our own index.
_BY = "tactileforge record"
# names of segments and of whole takes: SPLIT-TAKE.NUMBER.tar and SPLIT-TAKE.tar
_SEGMENT = re.compile(r"(?P<split>train|val)-(?P<take>\d{6})\.(?P<number>\d{4,})\.tar")
_TAKE = re.compile(r"(?P<split>train|val)-(?P<take>\d{6})\.tar")


class TakeStore:
    """Takes in a folder, with one writer at a time.

    Args:
        out: Folder of the recording.
        split: Split of new takes: ``train`` or ``val``.

    Attributes:
        notes: Repairs made when the folder was opened, one line each.
    """

    def __init__(self, out: Path, split: str) -> None:
        self.out, self.split = out, split
        self.notes: list[str] = []
        self._entries: dict[str, IndexEntry] = {}
        self._open = ExitStack()

    def __enter__(self) -> Self:
        """Opens the folder.

        Raises:
            ConfigError: The folder holds other shards, or another program records into it.
            OSError: The folder cannot be written.
        """
        ours = (self.out / NOTES).is_dir()
        taken = f"{self.out}: another program records into it; give another out="
        self._open.enter_context(locked(self.out / NOTES / "lock", taken))
        try:
            self._load(ours)
            self._recover()
        except BaseException:
            self.__exit__()
            raise
        return self

    def __exit__(self, *error: object) -> None:
        self._open.close()

    def _load(self, ours: bool) -> None:
        path = self.out / INDEX_FILE
        if path.exists():
            try:
                held = parse_index(path.read_bytes(), str(path))
            except DataError as error:
                self.notes.append(f"the index is made anew: {error}")
            else:
                ours = held.made.get("by") == _BY
                self._entries = {
                    entry.file: entry for rows in held.splits.values() for entry in rows
                }
        if not ours:
            refuse_shards(self.out)

    def _recover(self) -> None:
        """Deletes partial files, keeps complete ones, and joins interrupted takes."""
        for path in (self.out / NOTES).glob("*.tar*"):
            path.unlink()
        for name in list(self._entries):
            if not (self.out / name).exists():
                del self._entries[name]
                self.notes.append(f"{name} is in the index and not in the folder")
        for path in sorted(self.out.glob("*.tar")):
            if path.name not in self._entries:
                self._take_up(path)
        takes = {name for name in self._entries if _TAKE.fullmatch(name)}
        segments = [path for path in self.out.glob("*.tar") if _SEGMENT.fullmatch(path.name)]
        spare = [path for path in segments if _whole(path.name) in takes]
        for path in spare:  # the run was killed after joining, before deleting the segments
            self._entries.pop(path.name, None)
        if self._entries:
            self._save()
        for path in spare:  # after the index, which would list files that are gone
            path.unlink()
        for take in sorted({_whole(path.name) for path in segments} - takes):
            try:
                self._join(take)
            except DataError as error:
                self.notes.append(f"{take} stays in segments: {error}")

    def _take_up(self, path: Path) -> None:
        try:
            self._entries[path.name] = IndexEntry.of(path)
            self.notes.append(f"{path.name} was whole, and is now in the index")
        except DataError as error:
            self.notes.append(f"{path.name} is left out of the index: {error}")

    def new_take(self) -> int:
        """Returns the number of the next take."""
        parts = [_parts(path.name) for path in self.out.glob("*.tar")]
        return max((int(part["take"]) for part in parts if part), default=-1) + 1

    def write(
        self,
        take: int,
        number: int,
        recordings: Sequence[Packed],
        raw: Mapping[str, Raw],
    ) -> IndexEntry:
        """Writes one segment. On return it is synced to the disk.

        Args:
            take: Number of the take.
            number: Number of the segment in the take.
            recordings: Recordings, one for each sensor.
            raw: Raw values of devices, by name.

        Raises:
            OSError: The segment cannot be written; earlier ones stay.
        """
        return self._commit(f"{self.split}-{take:06d}.{number:04d}.tar", recordings, raw)

    def join(self, take: int) -> IndexEntry | None:
        """Joins the segments of a take into one shard.

        Returns:
            Row of the shard in the index; None without segments, or without room for the shard.

        Raises:
            OSError: The shard cannot be written; the segments stay.
        """
        return self._join(f"{self.split}-{take:06d}.tar")

    def _join(self, name: str) -> IndexEntry | None:
        segments = sorted(
            segment for segment in self._entries if _whole(segment) == name and segment != name
        )
        size = sum(self._entries[segment].bytes for segment in segments)
        # segments stay until the whole shard is on disk, so both need room
        if not segments or shutil.disk_usage(self.out).free < 1.1 * size:
            return None
        paths = [self.out / segment for segment in segments]
        entry = self._commit(name, merge_segments(paths), merge_raw(paths), instead_of=segments)
        for path in paths:
            path.unlink()
        return entry

    def _commit(
        self,
        name: str,
        recordings: Sequence[Packed],
        raw: Mapping[str, Raw],
        instead_of: Sequence[str] = (),
    ) -> IndexEntry:
        part = self.out / NOTES / name
        try:
            write_shard(part, recordings)
            append_raw(part, raw)
            _sync(part)  # before the rename: a name in the folder is a complete file
            entry = IndexEntry.of(part)
            part.replace(self.out / name)
        finally:
            part.unlink(missing_ok=True)
        before = dict(self._entries)
        for segment in instead_of:
            del self._entries[segment]
        self._entries[name] = entry
        try:
            self._save()
        except OSError:  # the index on disk is the old one, so the next one starts from it
            self._entries = before
            raise
        return entry

    def _save(self) -> None:
        rows = [self._entries[name] for name in sorted(self._entries)]
        splits = {
            split: [row for row in rows if row.file.startswith(f"{split}-")]
            for split in ("train", "val")
        }
        Index("record", splits, made={"by": _BY}).save(self.out / NOTES)
        _sync(self.out / NOTES / INDEX_FILE)
        (self.out / NOTES / INDEX_FILE).replace(self.out / INDEX_FILE)
        _sync(self.out)  # the rename itself is durable only once the folder is synced


def _parts(name: str) -> dict[str, str] | None:
    match = _SEGMENT.fullmatch(name) or _TAKE.fullmatch(name)
    return match.groupdict() if match else None


def _whole(name: str) -> str:
    """Name of the shard of the whole take; "" for other files."""
    parts = _parts(name)
    return f"{parts['split']}-{parts['take']}.tar" if parts else ""


def _sync(path: Path) -> None:
    """Flushes a file, or the entries of a folder, to disk."""
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
