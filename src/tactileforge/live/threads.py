"""How the threads of sensors share the interpreter."""

from __future__ import annotations

import gc
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from tactileforge.errors import SensorError


def within(seconds: float, what: str, call: Callable[[], object]) -> None:
    """Calls a driver in a thread of its own, which is left behind if it does not return.

    Args:
        seconds: How long it may take.
        what: It does, for messages.
        call: The call.

    Raises:
        SensorError: It has not returned in time, or has tried to end the program.
        Exception: What it raises.
    """
    ended: list[BaseException | None] = []

    def run() -> None:
        try:
            call()
            ended.append(None)
        except BaseException as error:  # it may exit as well, and a thread would in silence
            ended.append(error)

    thread = threading.Thread(target=run, name=f"driver-{what}", daemon=True)
    thread.start()
    thread.join(seconds)
    if not ended:
        raise SensorError(
            f"{what} of its driver has not returned within {seconds:g} s and is left behind: plug "
            "the device out and in"
        )
    if isinstance(ended[0], Exception):
        raise ended[0]
    if ended[0] is not None:
        raise SensorError(f"{what} of its driver ends with {ended[0]!r}") from ended[0]


@contextmanager
def quick_switches() -> Iterator[None]:
    """A thread whose frame has come must not wait for one that is writing, or for the collector.

    Everything that exists already is left out of garbage collection meanwhile: with torch
    imported, one pass over it stops all threads for a tenth of a second.
    """
    before = sys.getswitchinterval()
    sys.setswitchinterval(0.0001)
    gc.freeze()
    try:
        yield
    finally:
        gc.unfreeze()
        sys.setswitchinterval(before)
