"""Arithmetic over ranks: N processes compute the same as one with the joint batch.

Also the seeds of a step: all its randomness is a function of them.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Any

import numpy as np
import torch
import torch.distributed as dist
from torch import Tensor

from tactileforge.util.means import Mean

_ALONE: ContextVar[bool] = ContextVar("alone", default=False)


def count_processes(options: Mapping[str, Any]) -> int:
    """Number of processes of a run; at least 2 if it is not known yet.

    Args:
        options: Options of ``trainer``.
    """
    devices = options["devices"]
    if devices in ("auto", -1, "-1"):
        devices = 1 if options["accelerator"] == "cpu" else max(1, torch.cuda.device_count())
    # a list of devices counts as several: the answer decides only what one process may assume
    here = int(devices) if str(devices).isdecimal() else 2
    return max(here * int(options["num_nodes"]), int(os.environ.get("WORLD_SIZE", 1)))


def world() -> tuple[int, int]:
    """This process's rank and the number of processes; (0, 1) outside a process group."""
    if not _ALONE.get() and dist.is_available() and dist.is_initialized():
        return dist.get_rank(), dist.get_world_size()
    return 0, 1


@contextmanager
def alone() -> Iterator[None]:
    """Lets this process compute as if it were the only one, on data shared by all of them."""
    token = _ALONE.set(True)
    try:
        yield
    finally:
        _ALONE.reset(token)


def seed_step(seed: int, number: int, stream: int) -> None:
    """Seeds torch for one step.

    Args:
        seed: Seed of the run.
        number: Number of the batch, from 0.
        stream: Purpose of the numbers: 0 a training step, -1 validation, ``rank + 1`` flips.
    """
    entropy = [seed, number + 1, stream + 1]
    # SeedSequence mixes its words, so neighbouring steps have unrelated numbers; + 1, as it takes
    # none below 0
    state = np.random.SeedSequence(entropy).generate_state(1, np.uint64)[0]
    torch.manual_seed(int(state >> np.uint64(1)))


def rand_rows(rows: int, *columns: int, device: torch.device) -> Tensor:
    """Uniform numbers (rows, *columns) for this rank's rows of the joint batch.

    Every rank draws for the joint batch from a generator in the same state and keeps its own rows,
    so a sample gets the same numbers with any number of ranks.

    Example:
        >>> rand_rows(2, 3, device=torch.device("cpu")).shape
        torch.Size([2, 3])
    """
    rank, size = world()
    return torch.rand(size * rows, *columns, device=device)[rank * rows : (rank + 1) * rows]


def sum_over_ranks(x: Tensor) -> Tensor:
    """The sum over ranks, without gradients; ``x`` itself in a single process."""
    if world()[1] > 1:
        x = x.clone()  # all_reduce works in place
        dist.all_reduce(x)
    return x


def mean_over_ranks(x: Tensor) -> Tensor:
    """The mean over ranks, without gradients; ``x`` itself in a single process."""
    size = world()[1]
    return sum_over_ranks(x) / size if size > 1 else x


class _Gather(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, x: Tensor) -> Tensor:
        parts = [torch.empty_like(x) for _ in range(dist.get_world_size())]
        dist.all_gather(parts, x.contiguous())
        ctx.rows = len(x)
        return torch.cat(parts)

    @staticmethod
    def backward(ctx: Any, *grads: Tensor) -> Tensor:
        grad = grads[0].contiguous()
        # the losses of all ranks depend on these rows, so their gradients add up
        dist.all_reduce(grad)
        start = dist.get_rank() * ctx.rows
        return grad[start : start + ctx.rows]


def gather_rows(x: Tensor) -> Tensor:
    """Rows of every rank, in rank order, with gradients; ``x`` itself in a single process.

    Every rank must give the same number of rows.
    """
    if world()[1] == 1:
        return x
    out: Tensor = _Gather.apply(x)  # type: ignore[no-untyped-call]
    return out


def masked_mean(losses: Tensor, valid: Tensor) -> Mean:
    """Mean of the valid losses over all ranks, and how many there are.

    DDP averages gradients over ranks that may hold different numbers of labelled samples. Each
    rank's sum is divided by the joint count and multiplied by the number of ranks, so that the
    average is the joint mean.

    Args:
        losses: float (B,), one per sample, or of any other shape.
        valid: bool, of the same shape.

    Returns:
        The mean, connected to the graph and 0 even when nothing is valid, and the joint count.

    Example:
        >>> import torch
        >>> masked_mean(torch.tensor([1.0, 5.0, 3.0]), torch.tensor([True, False, True]))
        Mean(value=tensor(2.), count=tensor(2.))
    """
    return Mean(*_means(losses, valid, None))


def masked_means(losses: Tensor, valid: Tensor) -> list[Mean]:
    """The `masked_mean` of each row, or other item of the first axis, all in the same kernels.

    Args:
        losses: float (n, ...).
        valid: bool, of the same shape.

    Example:
        >>> import torch
        >>> masked_means(torch.tensor([[1.0, 5.0], [3.0, 9.0]]), torch.tensor([[True, True]] * 2))
        [Mean(value=tensor(3.), count=tensor(2.)), Mean(value=tensor(6.), count=tensor(2.))]
    """
    values, counts = _means(losses, valid, tuple(range(1, losses.ndim)))
    return [Mean(*row) for row in zip(values.unbind(), counts.unbind(), strict=True)]


def _means(losses: Tensor, valid: Tensor, dims: tuple[int, ...] | None) -> tuple[Tensor, Tensor]:
    # filled, not a product: a loss without label may be NaN, and 0 times NaN is NaN
    total = losses.masked_fill(~valid, 0).sum(dims)
    count = valid.sum(dims, dtype=torch.float32)
    size = world()[1]
    if size > 1:
        dist.all_reduce(count)
        total = total * size
    # without labels still connected to the graph: DDP waits for a gradient of every rank
    return total / count.clamp(min=1), count
