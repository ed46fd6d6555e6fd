"""Fetches files of a folder: on this machine, or behind any URL that webdataset opens."""

from __future__ import annotations

import hashlib
import os
import re
import time
from contextlib import suppress
from pathlib import Path
from urllib.parse import unquote, urlparse

from tactileforge.data.shards import remote
from tactileforge.errors import DataError

#: Bytes of an index; more are none of ours.
_MAX_TEXT = 1 << 28
#: Files of this process whose checksum is known, in the state in which it was read.
_CHECKED: set[tuple[str, int, int, int, str]] = set()


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
        """A small file, as it is now.

        Raises:
            DataError: It cannot be read.
        """
        try:
            if not self.remote:
                return (self.path / name).read_bytes()
            return b"".join(remote.chunks(f"{self.root}/{name}", _MAX_TEXT))
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
        if self.remote and path.exists() and not self._is(path, sha256):
            path.unlink(missing_ok=True)  # damaged since it was kept
        if self.remote and not path.exists():
            self._fetch(path, size, sha256)
        if not self._is(path, sha256):
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
                with path.open("rb") as file:
                    if hashlib.file_digest(file, "sha256").hexdigest() != sha256:
                        return False
                _CHECKED.add(state)
        except OSError as error:
            raise DataError(f"{path}: listed in the index, but not there ({error})") from error
        return True

    def _fetch(self, path: Path, size: int, sha256: str) -> None:
        path.parent.mkdir(parents=True, exist_ok=True)
        self._make_room(size)
        part = path.with_name(f"{path.name}.{os.getpid()}.part")
        digest, received = hashlib.sha256(), 0
        url = f"{self.root}/{path.name}"
        try:
            with part.open("wb") as out:
                for chunk in remote.chunks(url, size):
                    digest.update(chunk)
                    received += len(chunk)
                    out.write(chunk)
            if digest.hexdigest() != sha256:
                raise DataError(
                    f"{url}: {received} bytes with SHA-256 {digest.hexdigest()[:12]}..., but the "
                    f"index says {size} with {sha256[:12]}...; upload the shard again"
                )
            part.replace(path)
            _CHECKED.add(_state(path, sha256))
        except OSError as error:
            raise DataError(f"{url}: cannot be fetched ({error})") from error
        finally:
            part.unlink(missing_ok=True)

    def _make_room(self, size: int) -> None:
        if self.cache_gb is None:
            return
        cached = sorted(self.path.glob("*.tar"), key=lambda path: path.stat().st_atime)
        total = sum(path.stat().st_size for path in cached) + size
        for path in cached:
            if total <= self.cache_gb * 1e9:
                break
            total -= path.stat().st_size
            path.unlink(missing_ok=True)


def _state(path: Path, sha256: str) -> tuple[str, int, int, int, str]:
    status = path.stat()
    return str(path), status.st_ino, status.st_size, status.st_mtime_ns, sha256
