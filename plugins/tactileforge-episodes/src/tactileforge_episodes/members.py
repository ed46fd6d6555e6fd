"""Files in folders, zip and tar archives, read in part and never unpacked."""

from __future__ import annotations

import io
import lzma
import os
import struct
import tarfile
import zipfile
import zlib
from collections.abc import Iterable
from pathlib import Path
from tokenize import TokenError
from typing import IO, Protocol

from tactileforge.errors import DataError
from tactileforge_episodes.slices import Handle, Slice

#: Errors of damaged files, from the decoders of all formats.
DAMAGED = (
    *(zipfile.BadZipFile, tarfile.TarError, zlib.error, lzma.LZMAError, OSError, EOFError),
    *(RuntimeError, ValueError, TypeError, KeyError, IndexError, AttributeError, SyntaxError),
    *(OverflowError, MemoryError),
    TokenError,  # numpy reads headers as literals of Python
)
#: Largest member read as a whole, bytes.
_LARGEST = 1 << 32
#: Length of the fixed part of a local header of a zip, and its place of two lengths.
_LOCAL = struct.Struct("<26xHH")


class Members(Protocol):
    """Files by relative name, with ``/`` between folders."""

    def read(self, name: str, start: int = 0, stop: int | None = None) -> bytes | None:
        """Bytes of a file, or a part of them; None where there is no such file.

        Args:
            name: Name of the file.
            start: First byte; negative counts from the end.
            stop: End of the part; None for the end of the file.

        Raises:
            DataError: The file is damaged.
        """
        ...

    def children(self, folder: str) -> tuple[list[str], list[str]]:
        """Names of the folders and of the files in a folder, sorted."""
        ...

    def open(self, name: str) -> Slice:
        """A file, readable from any position.

        Raises:
            DataError: The file is compressed, or missing.
        """
        ...


class FolderMembers:
    """Files of a folder.

    Args:
        path: The folder.
    """

    def __init__(self, path: Path) -> None:
        self.path = path

    def read(self, name: str, start: int = 0, stop: int | None = None) -> bytes | None:
        """Bytes of a file; see `Members.read`."""
        try:
            with open(self.path / name, "rb") as file:
                return _part(file, start, stop)
        except (FileNotFoundError, IsADirectoryError, NotADirectoryError):
            return None
        except OSError as error:
            raise DataError(f"{self.path / name}: cannot be read ({error.strerror})") from error

    def children(self, folder: str) -> tuple[list[str], list[str]]:
        """Names of folders and files; see `Members.children`."""
        try:
            entries = sorted(os.scandir(self.path / folder), key=lambda entry: entry.name)
        except OSError:
            return [], []
        folders = [entry.name for entry in entries if entry.is_dir()]
        return folders, [entry.name for entry in entries if entry.is_file()]

    def open(self, name: str) -> Slice:
        """A file of the folder; see `Members.open`."""
        path = self.path / name
        try:
            return Slice(Handle(path))
        except OSError as error:
            raise DataError(f"{path}: cannot be read ({error.strerror})") from error


class ArchiveMembers:
    """Files of an archive, by their places.

    Args:
        path: The archive.
        names: Names of its members; folders end with ``/``.
    """

    def __init__(self, path: Path, names: Iterable[str]) -> None:
        self.path, self.folders = path, _tree(names)

    def children(self, folder: str) -> tuple[list[str], list[str]]:
        """Names of folders and files; see `Members.children`."""
        return self.folders.get(folder.strip("/"), ([], []))

    def open(self, name: str) -> Slice:
        """A member; see `Members.open`."""
        found = self._place(name)
        if found is None:
            raise DataError(f"{self.path}: no member {name}; download it again")
        return found

    def _place(self, name: str) -> Slice | None:
        """An uncompressed member; None without one."""
        raise NotImplementedError


class ZipMembers(ArchiveMembers):
    """Files in a zip archive; those stored without compression are read in part.

    Args:
        path: The archive.

    Raises:
        DataError: It is damaged, or encrypted.
    """

    def __init__(self, path: Path) -> None:
        try:
            self.file = Slice(Handle(path))
            self.archive = zipfile.ZipFile(self.file)
            self.entries = {entry.filename: entry for entry in self.archive.infolist()}
        except DAMAGED as error:
            raise DataError(f"{path}: not a readable zip ({error}); download it again") from error
        if any(entry.flag_bits & 1 for entry in self.entries.values()):
            raise DataError(f"{path}: is encrypted; unpack it, and give its folder")
        super().__init__(path, self.entries)

    def read(self, name: str, start: int = 0, stop: int | None = None) -> bytes | None:
        """Bytes of a file; see `Members.read`."""
        entry = self.entries.get(name)
        if entry is None or entry.is_dir():
            return None
        if entry.compress_type == zipfile.ZIP_STORED:
            return _part(self.open(name), start, stop)
        if entry.file_size > _LARGEST:
            raise DataError(f"{self.path}: {name} has {entry.file_size} bytes; unpack the archive")
        try:
            return _part(io.BytesIO(self.archive.read(entry)), start, stop)
        except DAMAGED as error:
            raise self._damaged(name, error) from error

    def _place(self, name: str) -> Slice | None:
        entry = self.entries.get(name)
        if entry is not None and entry.compress_type != zipfile.ZIP_STORED:
            raise DataError(
                f"{self.path}: {name} is compressed, so no part of it can be read; unpack the "
                "archive, and give its folder"
            )
        try:
            return None if entry is None else stored_part(self.file, entry)
        except zipfile.BadZipFile as error:
            raise self._damaged(name, error) from error

    def _damaged(self, name: str, why: object) -> DataError:
        return DataError(f"{self.path}: {name} cannot be read ({why}); download it again")


class TarMembers(ArchiveMembers):
    """Files in a tar archive, in any order; none may be compressed.

    Args:
        path: The archive.

    Raises:
        DataError: It is damaged, or compressed.
    """

    def __init__(self, path: Path) -> None:
        self.places: dict[str, tuple[int, int]] = {}
        try:
            with tarfile.open(path, "r:") as archive:
                for entry in archive:
                    if entry.isreg() and not entry.issparse():
                        name = entry.name.removeprefix("./")
                        self.places[name] = (entry.offset_data, entry.size)
                    archive.members = []  # type: ignore[attr-defined]  # or all stay in memory
            self.file = Slice(Handle(path))
        except DAMAGED as error:
            raise DataError(
                f"{path}: not a readable tar without compression ({error}); download it again, or "
                "unpack it"
            ) from error
        super().__init__(path, self.places)

    def read(self, name: str, start: int = 0, stop: int | None = None) -> bytes | None:
        """Bytes of a file; see `Members.read`."""
        found = self._place(name)
        if found is None:
            return None
        content = _part(found, start, stop)
        if start == 0 and stop is None and len(content) != self.places[name][1]:
            raise DataError(f"{self.path}: {name} is cut off; download it again")
        return content

    def _place(self, name: str) -> Slice | None:
        return self.file.part(*self.places[name]) if name in self.places else None


def stored_part(file: Slice, entry: zipfile.ZipInfo) -> Slice:
    """Content of a member of a zip stored without compression.

    Args:
        file: The archive.
        entry: The member.

    Raises:
        BadZipFile: There is no such member at its place.
    """
    header = file.part(entry.header_offset, _LOCAL.size).read()
    if len(header) < _LOCAL.size or header[:4] != b"PK\3\4":
        raise zipfile.BadZipFile("no local header")
    start = entry.header_offset + _LOCAL.size + sum(_LOCAL.unpack(header))
    return file.part(start, entry.file_size)


def _part(file: IO[bytes] | Slice, start: int, stop: int | None) -> bytes:
    if start:
        file.seek(start, os.SEEK_END if start < 0 else os.SEEK_SET)
    content = file.read() if stop is None else file.read(stop - start)
    return bytes(content)


def _tree(names: Iterable[str]) -> dict[str, tuple[list[str], list[str]]]:
    """Folders and files in each folder of an archive."""
    found: dict[str, tuple[set[str], set[str]]] = {"": (set(), set())}
    for name in names:
        parts = name.strip("/").split("/")
        if not name.strip("/") or ".." in parts:
            continue
        for depth in range(len(parts) - (not name.endswith("/"))):
            parent, child = "/".join(parts[:depth]), parts[depth]
            found.setdefault(parent, (set(), set()))[0].add(child)
            found.setdefault("/".join(parts[: depth + 1]), (set(), set()))
        if not name.endswith("/"):
            found["/".join(parts[:-1])][1].add(parts[-1])
    return {folder: (sorted(inner), sorted(files)) for folder, (inner, files) in found.items()}
