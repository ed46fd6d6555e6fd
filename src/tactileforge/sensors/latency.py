"""Interpreter settings for low-latency sensor threads."""

from __future__ import annotations

import gc
import sys
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def low_latency_threads() -> Iterator[None]:
    """Context with fast thread switches and short garbage collection, for frames without delay.

    Existing objects are left out of garbage collection meanwhile: with torch imported, one pass
    over them stops all threads for a tenth of a second.
    """
    before = sys.getswitchinterval()
    # 5 ms by default: a thread at work would delay each frame by that
    sys.setswitchinterval(0.0001)
    gc.freeze()
    try:
        yield
    finally:
        gc.unfreeze()
        sys.setswitchinterval(before)
