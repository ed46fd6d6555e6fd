"""Files of a folder of shards: on this machine, or behind any URL for webdataset."""

from __future__ import annotations

import hashlib
import os
import re
import time
from contextlib import suppress
from io import BytesIO
from pathlib import Path
from typing import BinaryIO
from urllib.parse import unquote, urlparse

from tactileforge.data.frames.image_codecs import TAR_BLOCK
from tactileforge.errors import DataError, home_path
from tactileforge.util import downloads, files
from tactileforge.util.files import new_part, sweep_parts
from tactileforge.util.regular import read_regular

#: Largest size of an index, bytes, and longest download of it, seconds.
_MAX_TEXT, _TEXT_SECONDS = 1 << 28, 1800.0
#: Largest size of a tar without an index, bytes.
_MAX_TAR = 1 << 36
#: Files verified by this process, in the state in which they were read.
_CHECKED: set[tuple[str, int, int, int, str]] = set()


#: Attempts to get a file before another process removes it from the cache.
_ATTEMPTS = 10


class ShardFolder:
    """A folder of shards.

    Args:
        root: Path, or URL (``https://...``, ``hf://...``, ``gs://...``).
        cache: Folder for downloaded files.
        cache_gb: Largest size of the cache, GB; None for no limit. The least recently used files
            are removed first.
    """

    def __init__(self, root: str, cache: Path, cache_gb: float | None = None) -> None:
        parts = urlparse(root)
        self.remote = (
            bool(re.fullmatch(r"[a-z][a-z0-9+]+", parts.scheme)) and parts.scheme != "file"
        )
        if parts.scheme == "pipe":  # webdataset would run it in a shell
            raise DataError(f"{root}: a command is never run to get data; give a path or a URL")
        self.root = root.rstrip("/")
        self.path = home_path(unquote(parts.path) if parts.scheme == "file" else root)
        self.cache_gb = cache_gb
        # a folder of its own for each URL: names of shards are the same everywhere
        if self.remote:
            self.path = cache / hashlib.sha256(self.root.encode()).hexdigest()[:16]

    def text(self, name: str) -> bytes:
        """Read a small file of JSON in its current state.

        Raises:
            DataError: The file cannot be read.
        """
        try:
            if not self.remote:
                return read_regular(self.path / name, _MAX_TEXT)
            content = BytesIO()
            downloads.copy(
                f"{self.root}/{name}",
                _MAX_TEXT,
                content,
                lambda: content.getvalue().rstrip().endswith(b"}"),
                seconds=_TEXT_SECONDS,
            )
            return content.getvalue()
        except OSError as error:
            raise DataError(f"{self.root}/{name}: cannot be read ({error})") from error

    def get(self, name: str, size: int, sha256: str) -> Path:
        """Verified file on this machine; downloads it to the cache if needed.

        Args:
            name: Name of the file in the folder.
            size: Size of the file, bytes.
            sha256: SHA-256 of the file, hexadecimal.

        Raises:
            DataError: The file is missing, or differs in size or checksum.
        """
        path = self.path / name
        for _ in range(_ATTEMPTS if self.remote else 1):
            with suppress(FileNotFoundError):
                return self._verified(path, size, sha256)
        why = (
            f"removed {_ATTEMPTS} times as soon as it was fetched; give more than "
            f"data.cache_gb={self.cache_gb}"
            if self.remote
            else "listed in the index, but not there"
        )
        raise DataError(f"{path}: {why}")

    def get_unchecked(self, name: str) -> Path:
        """File on this machine without a known checksum; downloads it to the cache if needed.

        Args:
            name: Name of the file in the folder.

        Raises:
            DataError: The file is missing, or cannot be fetched.
        """
        path = self.path / name
        if not self.remote or path.exists():
            if self.remote:
                with suppress(OSError):
                    os.utime(path, (time.time(), path.stat().st_mtime))
            return path
        path.parent.mkdir(parents=True, exist_ok=True)
        sweep_parts(path.parent)
        limit = _MAX_TAR if self.cache_gb is None else int(self.cache_gb * 1e9)
        url = f"{self.root}/{name}"
        try:
            with new_part(path) as part:
                with part.open("wb") as out:
                    downloads.copy(url, limit, out, lambda: _has_end(out, part))
                self._make_room(part.stat().st_size)
                part.replace(path)
        except OSError as error:
            raise DataError(
                f"{url}: cannot be fetched ({error}); correct the URL, or download the file and "
                "give its folder"
            ) from error
        return path

    def _verified(self, path: Path, size: int, sha256: str) -> Path:
        """Path of the file; other processes may remove it from the cache at any time."""
        if self.remote and not (path.exists() and self._has_checksum(path, sha256)):
            self._fetch(path, size, sha256)  # also in place of a file damaged in the cache
        # the user's own folder is never written to
        elif not self._has_checksum(path, sha256):
            raise DataError(
                f"{path}: {path.stat().st_size} bytes that are not the {size} of the index (their "
                "SHA-256 is another): damaged, or another shard; download or pack it again"
            )
        if self.remote:
            with suppress(OSError):
                # marks it as used: mounts with noatime or relatime do not record every read
                os.utime(path, (time.time(), path.stat().st_mtime))
        return path

    def _has_checksum(self, path: Path, sha256: str) -> bool:
        """Whether a file has a checksum; reads each state of a file once in a process."""
        try:
            state = _state(path, sha256)
            if state not in _CHECKED:
                if files.sha256(path) != sha256:
                    return False
                _CHECKED.add(state)
        except FileNotFoundError:
            raise
        except OSError as error:
            raise DataError(f"{path}: cannot be read ({error})") from error
        return True

    def _fetch(self, path: Path, size: int, sha256: str) -> None:
        path.parent.mkdir(parents=True, exist_ok=True)
        sweep_parts(path.parent)
        self._make_room(size)
        url = f"{self.root}/{path.name}"
        try:
            with new_part(path) as part:
                with part.open("wb") as out:
                    downloads.copy(url, size, out, lambda: out.tell() == size)
                found = files.sha256(part)
                if found != sha256:
                    raise DataError(
                        f"{url}: {part.stat().st_size} bytes with SHA-256 {found[:12]}..., but the "
                        f"index says {size} with {sha256[:12]}...; upload the shard again"
                    )
                part.replace(path)
            _CHECKED.add(_state(path, sha256))
        except FileNotFoundError:
            raise
        except OSError as error:
            raise DataError(f"{url}: cannot be fetched ({error})") from error

    def _make_room(self, size: int) -> None:
        if self.cache_gb is None:
            return
        cached = []
        for path in self.path.glob("*.tar"):
            with suppress(FileNotFoundError):  # another process makes room, too
                status = path.stat()
                cached.append((status.st_atime, path, status.st_size))

        total = sum(row[-1] for row in cached) + size
        # by the time of the last use: what was not read for longest goes first
        for _, path, taken in sorted(cached):
            if total <= self.cache_gb * 1e9:
                break
            total -= taken
            path.unlink(missing_ok=True)


def _has_end(out: BinaryIO, path: Path) -> bool:
    """Whether a tar ends with its mark, two blocks of zeros (POSIX, ustar), while it is open."""
    out.flush()
    with path.open("rb") as file:
        size = file.seek(0, os.SEEK_END)
        file.seek(max(0, size - 2 * TAR_BLOCK))
        return file.read() == bytes(2 * TAR_BLOCK)


def _state(path: Path, sha256: str) -> tuple[str, int, int, int, str]:
    # with the inode: a file put in place of another may have its size and time
    status = path.stat()
    return str(path), status.st_ino, status.st_size, status.st_mtime_ns, sha256
