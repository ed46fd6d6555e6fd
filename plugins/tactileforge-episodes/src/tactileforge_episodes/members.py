"""Files in folders, zip and tar archives, read in part and never unpacked."""

from __future__ import annotations

import io
import lzma
import os
import struct
import tarfile
import weakref
import zipfile
import zlib
from collections.abc import Iterable
from pathlib import Path
from typing import IO, Protocol

from tactileforge.plugin import DataError

#: Errors of damaged archives.
_DAMAGED = (
    *(zipfile.BadZipFile, tarfile.TarError, zlib.error, lzma.LZMAError),
    *(EOFError, NotImplementedError, RuntimeError),
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


class ZipMembers:
    """Files in a zip archive; those stored without compression are read in part.

    Args:
        path: The archive.

    Raises:
        DataError: It is damaged, or encrypted.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        try:
            self.handle = Handle(path)
            self.archive = zipfile.ZipFile(Slice(self.handle))
            self.entries = {entry.filename: entry for entry in self.archive.infolist()}
        except (*_DAMAGED, OSError, ValueError) as error:
            raise DataError(f"{path}: not a readable zip ({error}); download it again") from error
        if any(entry.flag_bits & 1 for entry in self.entries.values()):
            raise DataError(f"{path}: is encrypted; unpack it, and give its folder")
        self.folders = _tree(self.entries)

    def read(self, name: str, start: int = 0, stop: int | None = None) -> bytes | None:
        """Bytes of a file; see `Members.read`."""
        entry = self.entries.get(name)
        if entry is None or entry.is_dir():
            return None
        if entry.compress_type == zipfile.ZIP_STORED:
            return _part(Slice(self.handle, self._offset(entry), entry.file_size), start, stop)
        if entry.file_size > _LARGEST:
            raise DataError(f"{self.path}: {name} has {entry.file_size} bytes; unpack the archive")
        try:
            return _part(io.BytesIO(self.archive.read(entry)), start, stop)
        except (*_DAMAGED, OSError, ValueError) as error:
            raise self._damaged(name, error) from error

    def children(self, folder: str) -> tuple[list[str], list[str]]:
        """Names of folders and files; see `Members.children`."""
        return self.folders.get(folder.strip("/"), ([], []))

    def open(self, name: str) -> Slice:
        """A member stored without compression; see `Members.open`."""
        entry = self.entries.get(name)
        if entry is None:
            raise DataError(f"{self.path}: no member {name}; download it again")
        if entry.compress_type != zipfile.ZIP_STORED:
            raise DataError(
                f"{self.path}: {name} is compressed, so no part of it can be read; unpack the "
                "archive, and give its folder"
            )
        return Slice(self.handle, self._offset(entry), entry.file_size)

    def _offset(self, entry: zipfile.ZipInfo) -> int:
        header = os.pread(self.handle.descriptor, _LOCAL.size, entry.header_offset)
        if len(header) < _LOCAL.size or header[:4] != b"PK\3\4":
            raise self._damaged(entry.filename, "no local header")
        name, extra = _LOCAL.unpack(header)
        return entry.header_offset + _LOCAL.size + int(name) + int(extra)

    def _damaged(self, name: str, why: object) -> DataError:
        return DataError(f"{self.path}: {name} cannot be read ({why}); download it again")


class TarMembers:
    """Files in a tar archive, in any order; none may be compressed.

    Args:
        path: The archive.

    Raises:
        DataError: It is damaged, or compressed.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.places: dict[str, tuple[int, int]] = {}
        try:
            with tarfile.open(path, "r:") as archive:
                for entry in archive:
                    if entry.isreg() and not entry.issparse():
                        name = entry.name.removeprefix("./")
                        self.places[name] = (entry.offset_data, entry.size)
                    archive.members = []  # type: ignore[attr-defined]  # or all stay in memory
            self.handle = Handle(path)
        except (*_DAMAGED, OSError, ValueError) as error:
            raise DataError(
                f"{path}: not a readable tar without compression ({error}); download it again, or "
                "unpack it"
            ) from error
        self.folders = _tree(self.places)

    def read(self, name: str, start: int = 0, stop: int | None = None) -> bytes | None:
        """Bytes of a file; see `Members.read`."""
        if name not in self.places:
            return None
        content = _part(Slice(self.handle, *self.places[name]), start, stop)
        if start == 0 and stop is None and len(content) != self.places[name][1]:
            raise DataError(f"{self.path}: {name} is cut off; download it again")
        return content

    def children(self, folder: str) -> tuple[list[str], list[str]]:
        """Names of folders and files; see `Members.children`."""
        return self.folders.get(folder.strip("/"), ([], []))

    def open(self, name: str) -> Slice:
        """A member; see `Members.open`."""
        if name not in self.places:
            raise DataError(f"{self.path}: no member {name}; download it again")
        return Slice(self.handle, *self.places[name])


class Handle:
    """A file on disk, open for reading by position; closed with its last user.

    Args:
        path: The file.

    Raises:
        OSError: It cannot be opened.
    """

    def __init__(self, path: Path) -> None:
        self.descriptor = os.open(path, os.O_RDONLY | getattr(os, "O_CLOEXEC", 0))
        self.size = os.fstat(self.descriptor).st_size
        weakref.finalize(self, os.close, self.descriptor)


class Slice(io.RawIOBase):
    """A part of a file as a file of its own; positions are not shared.

    Args:
        handle: The open file.
        offset: First byte.
        size: Number of bytes; None for all that follow.
    """

    def __init__(self, handle: Handle, offset: int = 0, size: int | None = None) -> None:
        self._handle, self._offset, self._at = handle, offset, 0
        self._size = handle.size - offset if size is None else size

    def readable(self) -> bool:
        """Always True."""
        return True

    def seekable(self) -> bool:
        """Always True."""
        return True

    def tell(self) -> int:
        """The position, in bytes."""
        return self._at

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> int:
        """Moves the position, and returns it."""
        start = {os.SEEK_SET: 0, os.SEEK_CUR: self._at, os.SEEK_END: self._size}[whence]
        self._at = max(0, start + offset)
        return self._at

    def readinto(self, buffer: memoryview) -> int:  # type: ignore[override]
        """Fills a buffer, and returns the number of bytes."""
        count = max(0, min(len(buffer), self._size - self._at))
        content = os.pread(self._handle.descriptor, count, self._offset + self._at)
        buffer[: len(content)] = content
        self._at += len(content)
        return len(content)

    def read(self, size: int | None = -1) -> bytes:
        """Reads bytes; all that follow for -1."""
        left = max(0, self._size - self._at)
        count = left if size is None or size < 0 else min(size, left)
        content = os.pread(self._handle.descriptor, count, self._offset + self._at)
        self._at += len(content)
        return content


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
