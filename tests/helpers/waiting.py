"""Waiting for other threads and processes."""

import time
from collections.abc import Callable

import pytest


def wait_until(
    holds: Callable[[], object], seconds: float = 60, what: str = "it does not come"
) -> None:
    """Waits until a condition holds; a test that would hang fails after so many seconds."""
    end = time.monotonic() + seconds
    while not holds():
        if time.monotonic() > end:
            pytest.fail(f"{what} (in {seconds} s)")
        time.sleep(0.005)
