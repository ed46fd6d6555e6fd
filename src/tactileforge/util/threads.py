"""Settings of torch on a CPU: its threads, and numbers near 0."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
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


@cache
def usable_after_fork() -> None:
    """Let torch compute in processes that are forked from this one, with one thread each.

    Threads do not survive a fork, but OpenMP waits for those of the parent: the first product of
    matrices in the child would never end. A child with one thread asks for no other; it may start
    some of its own by ``torch.set_num_threads``, if the parent had one alone.
    """
    if hasattr(os, "register_at_fork"):  # Windows forks none
        os.register_at_fork(after_in_child=lambda: torch.set_num_threads(1))
