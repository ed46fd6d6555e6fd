"""Ways in which torch computes on a CPU: its threads, and numbers near 0."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import torch


@contextmanager
def one_thread() -> Iterator[None]:
    """Computes with one thread: sums depend on their number, and small ones wait for each other.

    Example:
        >>> with one_thread():
        ...     torch.get_num_threads()
        1
    """
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(before)


@contextmanager
def flushed() -> Iterator[None]:
    """Leaves out work of the CPU that changes no result worth its time.

    Numbers below 1e-38 become 0. Attention that hardly looks somewhere has such weights, and
    products with them take a hundred times as long. Memory is not filled before it is written,
    which torch else does where it is deterministic.

    Example:
        >>> with flushed():
        ...     (torch.full((8,), 1e-30) * 1e-10).sum().item()
        0.0
    """
    deterministic: Any = torch.utils.deterministic
    before = deterministic.fill_uninitialized_memory
    torch.set_flush_denormal(True)
    deterministic.fill_uninitialized_memory = False
    try:
        yield
    finally:
        torch.set_flush_denormal(False)
        deterministic.fill_uninitialized_memory = before
