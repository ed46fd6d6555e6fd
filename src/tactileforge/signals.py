"""Signals that end a run in good order: Ctrl-C, SIGTERM, and SIGHUP of a terminal that is gone."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from types import FrameType
from typing import Any

#: Those that ask a program to end.
ENDING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
#: Handlers that `handled` has set.
_OURS: set[Any] = set()
_MASKS = threading.local()


def _hold_signals() -> None:
    """Keeps signals back over a fork: one that comes to the child in it would be forgotten."""
    _MASKS.before = signal.pthread_sigmask(signal.SIG_BLOCK, ENDING)


def _let_through() -> None:
    signal.pthread_sigmask(signal.SIG_SETMASK, _MASKS.before)


def _end_by_signals() -> None:
    for number in ENDING:
        if signal.getsignal(number) in _OURS:
            signal.signal(number, signal.SIG_DFL)
    _let_through()


os.register_at_fork(
    before=_hold_signals, after_in_parent=_let_through, after_in_child=_end_by_signals
)


@contextmanager
def handled(
    handler: Callable[[int, FrameType | None], None], numbers: Sequence[int] = ENDING
) -> Iterator[None]:
    """Hands signals to a function; elsewhere than in the main thread nothing is changed.

    A signal that is ignored stays so, as `nohup` asks. A process that is forked meanwhile is ended
    by the signal, as it would be without this.

    Args:
        handler: As `signal.signal` wants it.
        numbers: The signals.
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
    """Within, SIGTERM and SIGHUP raise a KeyboardInterrupt, as Ctrl-C does; it names them."""

    def heard(number: int, frame: FrameType | None) -> None:
        raise KeyboardInterrupt(f"stopped by {signal.Signals(number).name}")

    with handled(heard, (signal.SIGTERM, signal.SIGHUP)):
        yield


@contextmanager
def stopped_by_signals() -> Iterator[threading.Event]:
    """An event that Ctrl-C, SIGTERM and SIGHUP set; the second of them ends at once."""
    stop = threading.Event()

    def heard(number: int, frame: FrameType | None) -> None:
        if stop.is_set():
            raise KeyboardInterrupt
        stop.set()

    with handled(heard):
        yield stop
