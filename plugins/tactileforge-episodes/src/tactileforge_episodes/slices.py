"""Parts of files on disk, read by position."""

from __future__ import annotations

import io
import os
import weakref
from pathlib import Path

from tactileforge.reading import open_regular


class Handle:
    """A file on disk, open for reading by position; closed with its last user.

    Args:
        path: The file.

    Raises:
        OSError: It cannot be opened.
        DataError: It is not a regular file.
    """

    def __init__(self, path: Path) -> None:
        self._keep(open_regular(path))

    @classmethod
    def of(cls, descriptor: int) -> Handle:
        """An open file by its descriptor, closed with its last user."""
        made = cls.__new__(cls)
        made._keep(descriptor)
        return made

    def _keep(self, descriptor: int) -> None:
        self.descriptor = descriptor
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

    def part(self, offset: int, size: int) -> Slice:
        """A part of this part, with a position of its own."""
        return Slice(self._handle, self._offset + offset, size)

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
        """Reads bytes; the whole rest for -1."""
        left = max(0, self._size - self._at)
        count = left if size is None or size < 0 else min(size, left)
        content = os.pread(self._handle.descriptor, count, self._offset + self._at)
        self._at += len(content)
        return content
