"""Numbered work, spread over processes; each leaves files, so that a killed command goes on."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack
from tempfile import TemporaryFile
from typing import IO, Any, TypeVar

from tactileforge import strict
from tactileforge.errors import TactileForgeError

_Options = TypeVar("_Options")


def cpus() -> int:
    """Number of CPUs that this process may use: fewer than there are, where a scheduler says so."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def process_count(pieces: int, asked: int | None) -> int:
    """Number of processes for some pieces of work.

    Args:
        pieces: More processes than that have nothing to do.
        asked: None for one for each CPU that may be used.

    Example:
        >>> process_count(3, asked=8)
        3
    """
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
        command: Module and words; each process is given its share of the numbers after them.
        numbers: The work, in order.
        count: How many processes.
        done: Whether a number is done.
        bar: Progress bar, advanced by what is done.

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
            process = stack.enter_context(subprocess.Popen(words, stderr=said))
            stack.callback(process.kill)
            running.append((process, said))
        while any([_runs(process, said) for process, said in running]):
            time.sleep(0.1)
            advance()
        advance()


def _runs(process: subprocess.Popen[bytes], said: IO[str]) -> bool:
    """Whether it still runs; raises where it failed."""
    if status := process.poll():
        said.seek(0)
        last = said.read().strip().rpartition("\n")[2]
        raise TactileForgeError(last or f"a process ended with status {status}")
    return status is None


def while_waited_for(numbers: Iterable[int]) -> Iterator[int]:
    """Numbers of a share, as long as the process that started this one is there."""
    parent = os.getppid()
    for number in numbers:
        if os.getppid() != parent:  # it was killed: nobody waits for the rest
            return
        yield number


def run_share(
    kind: type[_Options], work: Callable[[_Options, Iterable[int], Callable[[], object]], None]
) -> None:
    """Does the share of one process of `spread`: its words are options as JSON, then numbers.

    Args:
        kind: Dataclass of the options.
        work: Does numbers, given the options, the numbers and what to call after each.
    """
    config, *numbers = sys.argv[1:]
    try:
        options = strict.build(kind, "", json.loads(config))
        work(options, while_waited_for(map(int, numbers)), lambda: None)
    except (TactileForgeError, OSError) as error:
        sys.exit(str(error))
