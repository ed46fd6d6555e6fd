"""Numbered work, spread over processes; its files let a killed command continue."""

from __future__ import annotations

import json
import multiprocessing
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterable, Sequence
from contextlib import ExitStack
from functools import partial
from tempfile import TemporaryFile
from typing import IO, Any, TypeVar

from tactileforge.errors import ConfigError, TactileForgeError
from tactileforge.util import strict

_Options = TypeVar("_Options")

#: Environment variable with the number of the process to end with.
_PARENT = "TACTILEFORGE_PARENT"
#: Seconds between two checks for that process; and from SIGTERM, after which training saves a
#: checkpoint, to the forced end.
_LOOK, _GRACE = 0.5, 10.0
#: Bytes kept of the end of a program's standard error.
_TAIL = 4000


def cpus() -> int:
    """Number of CPUs available to this process; a scheduler may allow fewer than there are."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def process_count(pieces: int, asked: int | None) -> int:
    """Number of processes for some pieces of work.

    Args:
        pieces: Number of pieces; further processes would have nothing to do.
        asked: Number of processes asked for; None for one per available CPU.

    Raises:
        ConfigError: Fewer than one are asked for.

    Example:
        >>> process_count(3, asked=8)
        3
    """
    if asked is not None and asked < 1:
        raise ConfigError(f"processes={asked}: give 1 or more, or null for one per core")
    return min(pieces, asked or cpus())


def spread(
    command: Sequence[str],
    numbers: Sequence[int],
    count: int,
    done: Callable[[int], bool],
    bar: Any,
) -> None:
    """Runs ``python -m COMMAND NUMBERS`` in processes; they stop when one fails, or this one stops.

    Args:
        command: Module and words; each process gets its share of the numbers after them.
        numbers: Numbers of the work, in order.
        count: Number of processes.
        done: Function that tells whether a number is done.
        bar: Progress bar, advanced by the numbers done.

    Raises:
        TactileForgeError: A process failed; its last line says why.
    """
    before = int(bar.n)

    def advance() -> None:
        if new := sum(map(done, numbers)) + before - int(bar.n):
            bar.update(new)

    with ExitStack() as stack:
        running = []
        for share in range(count):
            words = [sys.executable, "-m", *command, *map(str, numbers[share::count])]
            said = stack.enter_context(TemporaryFile("w+"))  # a pipe that nobody reads fills up
            process = stack.enter_context(
                subprocess.Popen(words, stderr=said, env=with_this_process())
            )
            stack.callback(process.kill)
            running.append((process, said))
        while any([_runs(process, said) for process, said in running]):
            time.sleep(0.1)
            advance()
        advance()


def _runs(process: subprocess.Popen[bytes], said: IO[str]) -> bool:
    """Whether a process still runs.

    Raises:
        TactileForgeError: The process failed; its last line says why.
    """
    if status := process.poll():
        said.seek(0)
        last = said.read().strip().rpartition("\n")[2]
        raise TactileForgeError(last or f"a process ended with status {status}")
    return status is None


def with_this_process() -> dict[str, str]:
    """Environment of a process to end with this one; it has to call `end_with_parent`."""
    return {**os.environ, _PARENT: str(os.getpid())}


def end_with_parent(parent: int | None = None) -> None:
    """Ends this process soon after its parent, by whatever cause the parent ends.

    Args:
        parent: Number of the parent process; None for the one set by `with_this_process`, or, in
            the further processes of a training run (``LOCAL_RANK`` above 0), for the actual
            parent. Without a parent nothing is done.
    """
    together = os.environ.get("LOCAL_RANK", "0") != "0"
    named = os.getppid() if together else int(os.environ.get(_PARENT, 0))
    if (parent or named) == os.getppid():
        follow = partial(_follow, parent or named)
        threading.Thread(target=follow, daemon=True, name="end with parent").start()


def _follow(parent: int) -> None:
    while os.getppid() == parent:
        time.sleep(_LOOK)
    os.kill(os.getpid(), signal.SIGTERM)
    time.sleep(_GRACE)
    os._exit(1)


def end_worker_with_main() -> None:
    """Ends this worker of ``multiprocessing`` soon after its parent.

    A worker of a forkserver has that server for a parent, which lives as long as its workers do: a
    main process killed by signal 9 would leave them all. The flag of daemons helps at a regular
    exit alone.
    """
    if (main := multiprocessing.parent_process()) is not None:
        threading.Thread(target=_end_after, args=(main,), daemon=True, name="end with main").start()


def _end_after(main: Any) -> None:
    main.join()
    os._exit(1)


def run_program(command: Sequence[str]) -> tuple[int, str]:
    """Runs a program to end with this process (`end_with_parent`), and shows its output.

    Args:
        command: Words of the command.

    Returns:
        Exit status, and the end of the program's standard error.

    Raises:
        KeyboardInterrupt: On Ctrl-C, after the program has ended too.
    """
    output = b""
    with subprocess.Popen(command, stderr=subprocess.PIPE, env=with_this_process()) as process:
        assert process.stderr is not None
        try:
            for chunk in iter(partial(os.read, process.stderr.fileno(), 4096), b""):
                sys.stderr.write(chunk.decode(errors="replace"))
                output = (output + chunk)[-_TAIL:]
        except KeyboardInterrupt:
            process.wait()  # the terminal signals it too, and it saves a checkpoint
            raise
    return process.returncode, output.decode(errors="replace")


def run_share(
    kind: type[_Options], work: Callable[[_Options, Iterable[int], Callable[[], object]], None]
) -> None:
    """Does the share of one process of `spread`: its words are options as JSON, then numbers.

    Args:
        kind: Dataclass of the options.
        work: Function that does numbers, from the options, the numbers and a function to call after
            each.
    """
    end_with_parent()
    config, *numbers = sys.argv[1:]
    try:
        options = strict.build(kind, "", json.loads(config))
        work(options, map(int, numbers), lambda: None)
    except (TactileForgeError, OSError) as error:
        sys.exit(str(error))
