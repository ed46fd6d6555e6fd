"""Locks of folders and files, released at the end of their process."""

from __future__ import annotations

import os
import platform
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO

from tactileforge.errors import ConfigError

try:
    import fcntl
except ImportError:  # Windows, where filelock does the locking
    fcntl = None  # type: ignore[assignment]

#: Lock files held by this process. The system lets a process lock a file twice, and drops the lock
#: as soon as the process closes any of its handles of that file.
_HELD: set[tuple[int, Path]] = set()


@contextmanager
def locked(path: Path, taken: str | None = None) -> Iterator[IO[str]]:
    """Holds a lock file until the context is left or the process ends.

    It is a POSIX record lock, which forked workers do not inherit: the workers of a killed run
    outlive it for a moment without blocking its resumption. (``flock`` is inherited by a fork, and
    so is a lock of ``filelock`` before 4.) Without such locks, on Windows, it is one of
    ``filelock``.

    Args:
        path: The lock file; it and its folder are created.
        taken: Error text if another process holds it, with ``{holder}`` for the text in the file;
            None waits for the lock.

    Raises:
        ConfigError: Another process, or this one, holds it.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    mine = os.getpid(), path.absolute()
    if mine in _HELD:  # checked before opening: closing the file would free the lock
        words = taken or f"{path}: process {{holder}} waits for itself"
        raise ConfigError(words.replace("{holder}", f"{mine[0]}, this one"))
    with path.open("a+") as file:
        try:
            release = _take(file, path, not taken)
        except BlockingIOError as error:
            file.seek(0)
            holder = file.read().strip() or "unknown"
            raise ConfigError(str(taken).replace("{holder}", holder)) from error
        _HELD.add(mine)
        try:
            file.truncate(0)
            file.write(f"{os.getpid()} on {platform.node()}")
            file.flush()
            yield file
        finally:
            file.truncate(0)
            _HELD.discard(mine)
            release()


def is_locked(path: Path) -> bool:
    """Whether a process holds a lock file."""
    if (os.getpid(), path.absolute()) in _HELD:
        return True
    try:
        with path.open("r+") as file:
            _take(file, path, waits=False)()
    except FileNotFoundError:
        return False
    except OSError:
        return True
    return False


def _take(file: IO[str], path: Path, waits: bool) -> Callable[[], object]:
    """Takes the lock of an open file, and returns a function for its release.

    Raises:
        BlockingIOError: Another process holds it, and ``waits`` is false.
    """
    if fcntl is not None:
        fcntl.lockf(file, fcntl.LOCK_EX | (0 if waits else fcntl.LOCK_NB))
        return lambda: None  # the end of the file handle gives it back
    from filelock import FileLock, Timeout

    # a file beside: on Windows, others could not read the holder in a locked one
    lock = FileLock(f"{path}.held", timeout=-1 if waits else 0)
    try:
        lock.acquire()
    except Timeout as error:
        raise BlockingIOError(f"{path} is held") from error
    return lock.release
