"""Signals to end a run in good order: Ctrl-C, SIGTERM, SIGUSR1, and SIGHUP of a closed terminal."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from multiprocessing import active_children
from multiprocessing.process import BaseProcess
from multiprocessing.util import Finalize
from types import FrameType
from typing import Any
from weakref import WeakSet

#: Signals that ask a program to end, as far as this system has them; batch systems warn a job of
#: its end by the last two (Slurm, submitit).
ENDING = tuple(
    getattr(signal, name)
    for name in ("SIGINT", "SIGTERM", "SIGHUP", "SIGUSR1", "SIGUSR2")
    if hasattr(signal, name)
)
#: Handlers that `handled` has set.
_OURS: set[Any] = set()
_MASKS = threading.local()
#: Processes started under `held`. A weak set, as each keeps a file descriptor open.
_STARTED: WeakSet[BaseProcess] = WeakSet()
#: Number of the process that kills those at its exit.
_kills_in = 0


def _block() -> set[Any]:
    """Blocks these signals in this thread; the signals blocked before. Windows blocks none."""
    if not hasattr(signal, "pthread_sigmask"):
        return set()
    return set(signal.pthread_sigmask(signal.SIG_BLOCK, ENDING))


def _block_only(numbers: set[Any]) -> None:
    if hasattr(signal, "pthread_sigmask"):
        signal.pthread_sigmask(signal.SIG_SETMASK, numbers)


def _hold_signals() -> None:
    """Blocks signals during a fork, because the child would lose one sent to it meanwhile."""
    _MASKS.before = _block()


def _let_through() -> None:
    _block_only(_MASKS.before)


def _end_by_signals() -> None:
    for number in ENDING:
        if signal.getsignal(number) in _OURS:
            signal.signal(number, signal.SIG_DFL)
    _STARTED.clear()
    _let_through()


if hasattr(os, "register_at_fork"):  # Windows starts its processes anew
    os.register_at_fork(
        before=_hold_signals, after_in_parent=_let_through, after_in_child=_end_by_signals
    )


@contextmanager
def handled(
    handler: Callable[[int, FrameType | None], None], numbers: Sequence[int] = ENDING
) -> Iterator[None]:
    """Handles signals by a function; outside of the main thread nothing is changed.

    An ignored signal stays ignored, as `nohup` asks. A process forked meanwhile is ended by the
    signal, as it would be without this handler.

    Args:
        handler: Function for `signal.signal`.
        numbers: Signals to handle.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    own = os.getpid()
    before = {number: signal.getsignal(number) for number in numbers}

    def heard(number: int, frame: FrameType | None) -> None:
        if os.getpid() == own:
            handler(number, frame)
        else:
            signal.signal(number, signal.SIG_DFL)
            os.kill(os.getpid(), number)

    kept = {number: old for number, old in before.items() if old is not signal.SIG_IGN}
    # before it is set, so that a process forked in between resets it
    _OURS.add(heard)
    for number in kept:
        signal.signal(number, heard)
    try:
        yield
    finally:
        _OURS.discard(heard)
        for number, old in kept.items():
            signal.signal(number, old)


@contextmanager
def interrupted_by_signals() -> Iterator[None]:
    """Turns SIGTERM and SIGHUP into a KeyboardInterrupt with the name of the signal."""

    def heard(number: int, frame: FrameType | None) -> None:
        raise KeyboardInterrupt(f"stopped by {signal.Signals(number).name}")

    with handled(heard, [number for number in ENDING if number != signal.SIGINT]):
        yield


@contextmanager
def stopped_by_signals() -> Iterator[threading.Event]:
    """Event set by Ctrl-C, SIGTERM and SIGHUP; a second signal raises a KeyboardInterrupt."""
    stop = threading.Event()

    def heard(number: int, frame: FrameType | None) -> None:
        if stop.is_set():
            raise KeyboardInterrupt
        stop.set()

    with handled(heard):
        yield stop


@contextmanager
def signals_held() -> Iterator[None]:
    """Blocks signals in this thread, and in processes started meanwhile.

    Such a process unblocks them by `leave_to_parent`: a signal during its start would end it, and
    with it the run of its parent. The exit of this program kills those that are left.
    """
    others = set(active_children())
    before = _block()
    try:
        yield
    finally:
        _kill_at_exit()
        _STARTED.update(set(active_children()) - others)
        _block_only(before)


def leave_to_parent() -> None:
    """Ignores signals in a process started under `held`, as only its parent ends it.

    A terminal, Slurm and systemd signal every process of a run. The parent still needs its workers
    then, to finish a step and save.
    """
    for number in ENDING:
        signal.signal(number, signal.SIG_IGN)
    if hasattr(signal, "pthread_sigmask"):
        signal.pthread_sigmask(signal.SIG_UNBLOCK, ENDING)


def _kill_at_exit() -> None:
    global _kills_in
    if _kills_in != os.getpid():  # a forked process has the variable, and not the finalizer
        # multiprocessing sends its children SIGTERM then, and waits
        Finalize(None, _end_started, exitpriority=100)
        _kills_in = os.getpid()


def _end_started() -> None:
    # SIGTERM from the parent would not do: it is lost where one of another sender is still pending
    if threading.current_thread() is threading.main_thread() and hasattr(signal, "SIGCHLD"):
        # torch raises an error in the handler of this signal, for workers that it did not end
        signal.signal(signal.SIGCHLD, signal.SIG_DFL)
    for process in list(_STARTED):
        if process.is_alive():
            process.kill()
