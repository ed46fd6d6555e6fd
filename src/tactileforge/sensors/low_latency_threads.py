"""How the threads of sensors share the interpreter."""

from __future__ import annotations

import gc
import sys
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def low_latency_threads() -> Iterator[None]:
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
