"""Files and groups with episodes below a folder, and opening them."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path, PurePosixPath
from stat import S_ISDIR, S_ISREG

from tactileforge.errors import DataError
from tactileforge.plugins import names as names_of
from tactileforge.reading import check_keys
from tactileforge_episodes.arrays import ArrayFile
from tactileforge_episodes.members import FolderMembers, Members, TarMembers, ZipMembers

#: Kinds of files by suffix.
KINDS = {".hdf5": "hdf5", ".h5": "hdf5", ".hdf": "hdf5", ".npz": "npz", ".mat": "mat"}
ARCHIVES = (".zip", ".tar")
#: Files in the folder of a zarr group, versions 2 and 3.
_GROUPS = {".zgroup", ".zmetadata", "zarr.json"}
#: Names of folders and files that computers put beside data.
_COMPANIONS = {"__MACOSX", "@eaDir", "lost+found"}


@dataclass(frozen=True)
class Place:
    """Place of a file or group with episodes.

    Attributes:
        path: File, archive or folder on disk.
        inner: Path inside of the archive, "" for its top and where there is none.
        kind: ``zarr``, ``hdf5``, ``npz`` or ``mat``, or a plugin of the kind ``containers``.
    """

    path: str
    inner: str
    kind: str

    def __str__(self) -> str:
        return f"{self.path}/{self.inner}" if self.inner else self.path

    @property
    def unpacked(self) -> Path:
        """Its path, or the one after unpacking its archive beside itself."""
        path = Path(self.path)
        if path.suffix not in ARCHIVES or path.is_dir():
            return path
        stem = path.with_suffix("")
        inner = PurePosixPath(self.inner).parts
        return stem.joinpath(*(inner[1:] if inner and inner[0] == stem.name else inner))


def find_places(root: Path, bad: Callable[[str], object]) -> Iterator[Place]:
    """Yields the files and groups below a folder, in order.

    Args:
        root: The folder, or a single file, group or archive.
        bad: Is told of archives that cannot be read, a line each.
    """
    yield from _below(root, bad, frozenset(), [0])


def _below(
    root: Path, bad: Callable[[str], object], above: frozenset[tuple[int, int]], seen: list[int]
) -> Iterator[Place]:
    """Yields the files and groups below a folder that lies in others; loops of links are named."""
    seen[0] += 1
    check_keys(root, seen[0])
    try:
        about = root.stat()
        names = sorted(os.listdir(root)) if S_ISDIR(about.st_mode) else []
    except OSError as error:
        if root.suffix in (*KINDS, *ARCHIVES, ".zarr"):
            bad(f"{root}: cannot be read ({error.strerror})")
        return
    if (kind := root.suffix.removeprefix(".")) in names_of("containers"):
        yield Place(str(root), "", kind)
    elif S_ISREG(about.st_mode):
        yield from _of_file(root, bad)
    elif not S_ISDIR(about.st_mode):
        if root.suffix in (*KINDS, *ARCHIVES):
            bad(f"{root}: no regular file but a pipe, socket or device; remove it")
    elif root.suffix == ".zarr" or _GROUPS & {*names}:
        yield Place(str(root), "", "zarr")
    elif (place := (about.st_dev, about.st_ino)) in above:
        bad(f"{root}: a link to a folder around itself, which is not followed; remove it")
    else:
        if not names and root.suffix in (*KINDS, *ARCHIVES):
            bad(f"{root}: no regular file but an empty folder; remove it")
        for name in names:
            if _is_data(name):
                yield from _below(root / name, bad, above | {place}, seen)


def _of_file(path: Path, bad: Callable[[str], object]) -> Iterator[Place]:
    if path.suffix in KINDS:
        yield Place(str(path), "", KINDS[path.suffix])
    elif path.suffix in ARCHIVES:
        try:
            members = _members(os.getpid(), str(path), _stamp(str(path)))
        except DataError as error:
            bad(str(error))
            return
        yield from _of_members(str(path), members, "")


def _of_members(path: str, members: Members, folder: str) -> Iterator[Place]:
    folders, files = members.children(folder)
    if folder.endswith(".zarr") or _GROUPS & {*files}:
        yield Place(path, folder, "zarr")
        return
    for name in sorted((*folders, *files)):
        inner = f"{folder}/{name}" if folder else name
        if not _is_data(name):
            continue
        if name in folders:
            yield from _of_members(path, members, inner)
        elif PurePosixPath(name).suffix in KINDS:
            yield Place(path, inner, KINDS[PurePosixPath(name).suffix])


def _is_data(name: str) -> bool:
    return not name.startswith(".") and name not in _COMPANIONS


def open_place(place: Place) -> ArrayFile:
    """Opens a file or group; the latest stay open in this process.

    Raises:
        DataError: It is damaged.
    """
    return _opened(os.getpid(), place, _stamp(place.path))


def _stamp(path: str) -> tuple[int, int]:
    """Time of the last change of a file or folder, and its size."""
    try:
        about = os.stat(path)
    except OSError as error:
        raise DataError(f"{path}: cannot be read ({error.strerror})") from error
    return about.st_mtime_ns, about.st_size


@lru_cache(maxsize=32)
def _opened(process: int, place: Place, stamp: tuple[int, int]) -> ArrayFile:
    """Opened anew once a file has changed, and in each process, as a fork would share it."""
    path = Path(place.path)
    if place.kind == "zarr":
        from tactileforge_episodes.zarrs import ZarrFile

        members = _members(process, place.path, stamp)
        return ZarrFile(str(place), members, place.inner)
    if place.kind in names_of("containers"):
        from tactileforge_episodes.contained import ContainedFile

        return ContainedFile(place.path, place.kind)
    parent = _members(process, place.path, stamp) if place.inner else FolderMembers(path.parent)
    file = parent.open(place.inner or path.name)
    if place.kind == "npz":
        from tactileforge_episodes.npz import NpzFile

        return NpzFile(str(place), file)
    if place.kind == "mat":
        from tactileforge_episodes.mat import open_mat

        return open_mat(str(place), file)
    from tactileforge_episodes.hdf import HdfFile

    # not by its path: HDF5 would refuse others to open the file for writing
    return HdfFile(str(place), file)


@lru_cache(maxsize=16)
def _members(process: int, path: str, stamp: tuple[int, int]) -> Members:
    """Members of a folder or archive; in each process anew, see `_opened`."""
    if Path(path).is_dir():
        return FolderMembers(Path(path))
    return TarMembers(Path(path)) if path.endswith(".tar") else ZipMembers(Path(path))
