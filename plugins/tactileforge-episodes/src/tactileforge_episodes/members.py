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
from tactileforge.reading import BoundedTarInfo, check_unpacked, open_regular, stays_inside
from tactileforge_episodes.slices import Handle, Slice

#: Errors of damaged files, from the decoders of all formats.
DAMAGED = (
    *(zipfile.BadZipFile, tarfile.TarError, zlib.error, lzma.LZMAError, OSError, EOFError),
    *(RuntimeError, ValueError, TypeError, KeyError, IndexError, AttributeError, SyntaxError),
    *(OverflowError, MemoryError),
    TokenError,  # numpy reads headers as literals of Python
)
#: Largest member that is read whole, bytes.
_LARGEST = 1 << 28
_TOO_LARGE = f"more than {_LARGEST} bytes, which no chunk has; download it again"
#: Ways of a zip to compress that are unpacked within limits.
_PACKED = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
#: Length of the fixed part of a local header of a zip, and its place of two lengths.
_LOCAL = struct.Struct("<26xHH")


class Members(Protocol):
    """Files by relative name, with ``/`` between folders.

    Attributes:
        left: Folders that were left out, a line each.
    """

    left: dict[str, None]

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

    def has(self, name: str) -> bool:
        """Whether there is a file of this name."""
        ...

    def files(self, folder: str) -> frozenset[str]:
        """Names of the files in a folder."""
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
    """Files of a folder. Links that loop or lead out of it are not followed.

    Args:
        path: The folder.

    Attributes:
        left: Folders that were left out, a line each.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.left: dict[str, None] = {}
        self._names: dict[str, tuple[int, frozenset[str]]] = {}

    def has(self, name: str) -> bool:
        """Whether there is such a file; see `Members.has`."""
        return os.path.isfile(f"{self.path}/{name}")

    def files(self, folder: str) -> frozenset[str]:
        """Names of the files in a folder, listed again once it has changed."""
        try:
            changed = os.stat(self.path / folder).st_mtime_ns
        except OSError:
            return frozenset()
        if self._names.get(folder, (0, None))[0] != changed:
            with os.scandir(self.path / folder) as entries:
                found = (one.name for one in entries if not one.is_dir(follow_symlinks=False))
                self._names[folder] = (changed, frozenset(found))
        return self._names[folder][1]

    def read(self, name: str, start: int = 0, stop: int | None = None) -> bytes | None:
        """Bytes of a file; see `Members.read`."""
        try:
            with os.fdopen(open_regular(self.path / name, self.path), "rb") as file:
                return _part(file, start, stop, f"{self.path / name}")
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
        folders = [entry.name for entry in entries if self._is_folder(entry)]
        return folders, [entry.name for entry in entries if _is_file(entry)]

    def _is_folder(self, entry: os.DirEntry[str]) -> bool:
        """Whether an entry is a folder, and no link that loops or leads away."""
        if not entry.is_symlink():
            return entry.is_dir(follow_symlinks=False)
        path = Path(entry.path)
        above = path.parent.resolve()
        inside = stays_inside(path, self.path)
        if inside and not above.is_relative_to(path.resolve()):
            return path.is_dir()
        if not inside or path.is_dir():
            self.left[f"{path}: a link that loops, or leads out of {self.path.name}"] = None
        return False

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
        self._sets: dict[str, frozenset[str]] = {}
        self.left: dict[str, None] = {}

    def has(self, name: str) -> bool:
        """Whether there is such a member; see `Members.has`."""
        folder, _, file = name.rpartition("/")
        return file in self.files(folder)

    def files(self, folder: str) -> frozenset[str]:
        """Names of the files in a folder; see `Members.files`."""
        if folder not in self._sets:
            self._sets[folder] = frozenset(self.folders.get(folder, ([], []))[1])
        return self._sets[folder]

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
            return _part(self.open(name), start, stop, f"{self.path}: {name}")
        why = check_unpacked(entry.compress_size, entry.file_size)
        if entry.compress_type not in _PACKED:
            why = f"compressed by method {entry.compress_type}"
        if why or entry.file_size > _LARGEST:
            raise DataError(
                f"{self.path}: {name}: {why or f'{entry.file_size} bytes'}; unpack the archive"
            )
        try:
            with self.archive.open(entry) as member:
                content = io.BytesIO(member.read(entry.file_size))
                return _part(content, start, stop, f"{self.path}: {name}")
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
            with tarfile.open(path, "r:", tarinfo=BoundedTarInfo) as archive:
                for entry in archive:
                    if entry.size < 0:
                        raise tarfile.ReadError(f"{entry.name!r} has {entry.size} bytes")
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
        content = _part(found, start, stop, f"{self.path}: {name}")
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
    if entry.header_offset < 0 or entry.file_size < 0:
        raise zipfile.BadZipFile("a negative place")
    header = file.part(entry.header_offset, _LOCAL.size).read()
    if len(header) < _LOCAL.size or header[:4] != b"PK\3\4":
        raise zipfile.BadZipFile("no local header")
    start = entry.header_offset + _LOCAL.size + sum(_LOCAL.unpack(header))
    return file.part(start, entry.file_size)


def _is_file(entry: os.DirEntry[str]) -> bool:
    try:
        return entry.is_file()
    except OSError:  # a link that loops
        return False


def _part(file: IO[bytes] | Slice, start: int, stop: int | None, where: str) -> bytes:
    # the size is asked first: a buffer of the limit's size takes ten times as long as the chunk
    end = file.seek(0, os.SEEK_END)
    begin = file.seek(start, os.SEEK_END if start < 0 else os.SEEK_SET)
    if stop is None and end - begin > _LARGEST:
        raise DataError(f"{where}: {_TOO_LARGE}")
    return bytes(file.read(max(0, (end if stop is None else min(stop, end)) - begin)))


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
