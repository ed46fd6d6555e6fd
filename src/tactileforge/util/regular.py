"""Files of data sets, opened only where they are regular: no pipe that waits for ever."""

from __future__ import annotations

import errno
import os
import stat
from pathlib import Path

from tactileforge.errors import DataError
from tactileforge.util.pointers import check_pointer

_FLAGS = os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_CLOEXEC", 0)
_FLAGS |= getattr(os, "O_BINARY", 0)
#: Largest text or chunk that is read whole, bytes.
MOST_WHOLE = 1 << 28


def open_regular(path: Path, root: Path | None = None) -> int:
    """Opens a regular file for reading, and returns its descriptor.

    A pipe, socket, device or folder is refused without waiting for it.

    Args:
        path: The file.
        root: Folder that a link may not leave, see `stays_inside`; None where links are followed.

    Raises:
        OSError: It cannot be opened.
        DataError: It is not a regular file, a link that leads out of ``root``, or a pointer of Git
            LFS.
    """
    follow = 0 if root is None else getattr(os, "O_NOFOLLOW", 0)
    try:
        descriptor = os.open(path, _FLAGS | follow)
    except OSError as error:
        if error.errno == errno.ENXIO:  # a socket, or a device without its driver
            raise DataError(f"{path}: no regular file; remove it") from error
        if root is None or error.errno not in (errno.ELOOP, errno.EMLINK):
            raise
        if not stays_inside(path, root):
            raise DataError(
                f"{path}: a link that loops, or leads out of the data set, which is not followed; "
                "put the file itself there"
            ) from error
        descriptor = os.open(path, _FLAGS)
    mode = os.fstat(descriptor).st_mode
    if not stat.S_ISREG(mode):
        os.close(descriptor)
        if stat.S_ISDIR(mode):
            raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
        raise DataError(f"{path}: no regular file but a pipe, socket or device; remove it")
    try:
        check_pointer(path)
    except DataError:
        os.close(descriptor)
        raise
    return descriptor


def check_regular(path: str | Path) -> None:
    """Refuses a pipe, socket or device: to open one may wait for ever.

    Args:
        path: A file that a library opens by its name; a folder passes, which no library opens.

    Raises:
        OSError: It is none, or is not there.
    """
    mode = os.stat(path).st_mode
    if not stat.S_ISREG(mode) and not stat.S_ISDIR(mode):
        raise OSError("no regular file but a pipe, socket or device")


def is_there(path: Path) -> bool:
    """Whether something has the name of an optional file.

    A folder, a pipe or a link to nothing in its place is opened, and named as no file: only what
    is absent may be left out without a word.

    Args:
        path: The file.
    """
    return os.path.lexists(path)


def read_regular(path: Path, most: int, root: Path | None = None) -> bytes:
    """Content of a regular file.

    Args:
        path: The file.
        most: Largest number of bytes.
        root: Folder that a link may not leave; None where links are followed.

    Raises:
        OSError: It cannot be read.
        DataError: It is not a regular file, larger, or a link that leads out of ``root``.
    """
    with os.fdopen(open_regular(path, root), "rb") as file:
        size = os.fstat(file.fileno()).st_size
        if size <= most:
            # a buffer of the limit's size would take ten times as long
            content = file.read(size + 1)
            if len(content) > size:  # it has grown
                content += file.read(most - size)
            if len(content) <= most:
                return content
    raise DataError(f"{path}: more than {most} bytes; download it again")


def regular_text(path: Path) -> str:
    """Text of a regular file in UTF-8, of at most `MOST_WHOLE` bytes.

    Raises:
        OSError: It cannot be read.
        DataError: It is not a regular file, or larger.
        UnicodeDecodeError: It is not UTF-8.
    """
    return read_regular(path, MOST_WHOLE).decode("utf-8")


def stays_inside(path: Path, root: Path) -> bool:
    """Whether a path, with its links followed, lies in a folder.

    Links may lead to the shared files (``blobs``) of a Hugging Face cache.

    Args:
        path: The file or folder.
        root: The folder.
    """
    try:
        real, folder = path.resolve(strict=True), root.resolve()
    except (OSError, RuntimeError):
        return False
    parts = folder.parts
    if "snapshots" in parts[2:]:
        repository = Path(*parts[: len(parts) - 1 - parts[::-1].index("snapshots")])
        if real.is_relative_to(repository / "blobs"):
            return True
    return real.is_relative_to(folder)
