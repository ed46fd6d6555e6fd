"""Interpreter settings for low-latency sensor threads."""

from __future__ import annotations

import gc
import sys
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def low_latency_threads() -> Iterator[None]:
    """Context with fast thread switches and short garbage collection, so that frames do not wait.

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
