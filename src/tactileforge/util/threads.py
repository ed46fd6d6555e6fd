"""Settings of torch on a CPU: its threads, and numbers near 0."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from typing import Any

import torch

#: Variables that choose a number of threads.
_WORDS = frozenset({"OMP_NUM_THREADS", "MKL_NUM_THREADS"})
#: Number that torch has chosen, and whether another was.
_DEFAULT = torch.get_num_threads()
_chosen = False


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


def use_threads(count: int | None) -> None:
    """Compute with a number of threads from now on, small work as well; None for torch's choice."""
    global _chosen
    if count:
        torch.set_num_threads(count)
        _chosen = True


@contextmanager
def few_threads(is_small: bool) -> Iterator[None]:
    """Computes small work with one thread, unless the number of threads was chosen.

    Threads spin while they wait for each other. Where other programs have the cores, one that has
    to wait for its core holds up all of them at every layer. A number counts as chosen by
    `use_threads`, ``torch.set_num_threads``, OMP_NUM_THREADS or MKL_NUM_THREADS.

    Args:
        is_small: Whether the work is small.

    Example:
        >>> with few_threads(is_small=True):
        ...     torch.get_num_threads() > 0
        True
    """
    chosen = _chosen or torch.get_num_threads() != _DEFAULT or not _WORDS.isdisjoint(os.environ)
    if chosen or not is_small:
        yield
        return
    with one_thread():
        yield


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
