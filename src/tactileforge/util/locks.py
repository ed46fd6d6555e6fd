"""Locks of folders and files, released at the end of their process."""

from __future__ import annotations

import fcntl
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO

from tactileforge.errors import ConfigError

#: Lock files held by this process. The system lets a process lock a file twice, and drops the lock
#: as soon as the process closes any of its handles of that file.
_HELD: set[tuple[int, Path]] = set()


@contextmanager
def locked(path: Path, taken: str | None = None) -> Iterator[IO[str]]:
    """Holds a lock file until the context is left or the process ends.

    It is a POSIX record lock, which forked workers do not inherit: the workers of a killed run
    outlive it for a moment without blocking its resumption. (``flock``, and with it ``filelock``,
    is inherited by a fork.)

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
            fcntl.lockf(file, fcntl.LOCK_EX | (fcntl.LOCK_NB if taken else 0))
        except BlockingIOError as error:
            file.seek(0)
            holder = file.read().strip() or "unknown"
            raise ConfigError(str(taken).replace("{holder}", holder)) from error
        _HELD.add(mine)
        try:
            file.truncate(0)
            file.write(f"{os.getpid()} on {os.uname().nodename}")
            file.flush()
            yield file
        finally:
            file.truncate(0)
            _HELD.discard(mine)


def is_locked(path: Path) -> bool:
    """Whether a process holds a lock file."""
    if (os.getpid(), path.absolute()) in _HELD:
        return True
    try:
        with path.open("r+") as file:
            fcntl.lockf(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except FileNotFoundError:
        return False
    except OSError:
        return True
    return False
