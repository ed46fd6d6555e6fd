"""Fetches files of a folder: on this machine, or behind any URL that webdataset opens."""

from __future__ import annotations

import hashlib
import os
import re
import time
from contextlib import suppress
from io import BytesIO
from pathlib import Path
from urllib.parse import unquote, urlparse

from tactileforge import downloads, files
from tactileforge.errors import DataError
from tactileforge.files import new_part, sweep_parts

#: Bytes of an index, and seconds that it may take; more are none of ours.
_MAX_TEXT, _TEXT_SECONDS = 1 << 28, 1800.0
#: Files of this process whose checksum is known, in the state in which it was read.
_CHECKED: set[tuple[str, int, int, int, str]] = set()


#: Times that a file may vanish from the cache while it is checked.
_GONE = 10


class ShardFolder:
    """A folder of shards.

    Args:
        root: A path, or a URL (``https://...``, ``hf://...``, ``gs://...``).
        cache: Where files of a URL are kept.
        cache_gb: What they may take together, GB; None for no limit. Files used longest ago go
            first.
    """

    def __init__(self, root: str, cache: Path, cache_gb: float | None = None) -> None:
        parts = urlparse(root)
        self.remote = (
            bool(re.fullmatch(r"[a-z][a-z0-9+]+", parts.scheme)) and parts.scheme != "file"
        )
        if parts.scheme == "pipe":
            raise DataError(f"{root}: a command is never run to get data; give a path or a URL")
        self.root = root.rstrip("/")
        self.path = Path(unquote(parts.path) if parts.scheme == "file" else root).expanduser()
        self.cache_gb = cache_gb
        if self.remote:
            self.path = cache / hashlib.sha256(self.root.encode()).hexdigest()[:16]

    def text(self, name: str) -> bytes:
        """A small file of JSON, as it is now.

        Raises:
            DataError: It cannot be read.
        """
        try:
            if not self.remote:
                return (self.path / name).read_bytes()
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
        """A file on this machine, checked; what has to be fetched is kept.

        Args:
            name: Its name in the folder.
            size: Its size in bytes.
            sha256: Its checksum.

        Raises:
            DataError: It is not there, or is another file than was asked for.
        """
        path = self.path / name
        for _ in range(_GONE if self.remote else 1):
            with suppress(FileNotFoundError):
                return self._got(path, size, sha256)
        why = (
            f"removed {_GONE} times as soon as it was fetched; give more than "
            f"data.cache_gb={self.cache_gb}"
            if self.remote
            else "listed in the index, but not there"
        )
        raise DataError(f"{path}: {why}")

    def _got(self, path: Path, size: int, sha256: str) -> Path:
        """The file; other processes may remove it from the cache at any time."""
        if self.remote and not (path.exists() and self._is(path, sha256)):
            self._fetch(path, size, sha256)  # in place of what was damaged since it was kept
        elif not self._is(path, sha256):
            raise DataError(
                f"{path}: {path.stat().st_size} bytes that are not the {size} of the index (their "
                "SHA-256 is another): damaged, or another shard; download or pack it again"
            )
        if self.remote:
            with suppress(OSError):
                os.utime(path, (time.time(), path.stat().st_mtime))  # used now
        return path

    def _is(self, path: Path, sha256: str) -> bool:
        """Whether a file has a checksum; each state of a file is read once in a process."""
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
        for _, path, taken in sorted(cached):
            if total <= self.cache_gb * 1e9:
                break
            total -= taken
            path.unlink(missing_ok=True)


def _state(path: Path, sha256: str) -> tuple[str, int, int, int, str]:
    status = path.stat()
    return str(path), status.st_ino, status.st_size, status.st_mtime_ns, sha256
