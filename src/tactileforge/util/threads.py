"""Settings of torch on a CPU: its threads, and numbers near 0."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import torch


@contextmanager
def one_thread() -> Iterator[None]:
    """Computes with one thread.

    Sums depend on the number of threads, and in small operations threads mostly wait for each
    other.

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
    """Saves CPU time without a relevant change of results.

    Denormal numbers, below 1e-38, become 0: very small attention weights are denormal, and products
    with them take a hundred times as long. Memory is not filled before it is written, as torch
    otherwise does in its deterministic mode.

    Example:
        >>> with flushed():
        ...     (torch.full((8,), 1e-30) * 1e-10).sum().item()
        0.0
    """
    deterministic: Any = torch.utils.deterministic
    before = deterministic.fill_uninitialized_memory
    is_flushed = (torch.full((1,), 1e-30) * 1e-10).item() == 0  # torch has no other way to ask
    torch.set_flush_denormal(True)
    deterministic.fill_uninitialized_memory = False
    try:
        yield
    finally:
        torch.set_flush_denormal(is_flushed)
        deterministic.fill_uninitialized_memory = before
