"""Non-finite numbers: their first step is found, and they are never saved."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import torch
import torch.distributed as dist
from torch import Tensor, nn

from tactileforge.errors import TactileForgeError
from tactileforge.util.distributed import sum_over_ranks, world


class NotFiniteError(TactileForgeError):
    """Losses or weights are not finite; progress since the last checkpoint is lost."""


class FiniteWatch:
    """Notes the first step with a non-finite value of each loss, without waiting for the device.

    Args:
        keys: Names of the objectives.
    """

    def __init__(self, keys: Sequence[str]) -> None:
        self.keys = list(keys)
        self._first: Tensor | None = None
        self._odd: frozenset[str] = frozenset()

    def start(self, module: nn.Module) -> None:
        """Notes buffers with non-finite numbers on purpose, such as a mask of attention.

        Args:
            module: Module of the run, before its first step.
        """
        self._odd = frozenset(broken(module.named_buffers()))

    def note(self, losses: Mapping[str, Tensor], step: int) -> None:
        """Checks the losses of a step.

        Args:
            losses: Loss of each computed objective, a scalar.
            step: Optimiser steps taken so far.
        """
        some = next(iter(losses.values()), None)
        if some is None:
            return
        # infinity stands for never: the minimum over steps and ranks keeps the first bad step
        never = torch.full((), torch.inf, device=some.device)
        if self._first is None:
            self._first = never.expand(len(self.keys)).clone()
        bad = [
            torch.where(torch.isfinite(losses[key].detach()), never, float(step))
            if key in losses
            else never
            for key in self.keys
        ]
        self._first = torch.minimum(self._first, torch.stack(bad))

    def check(self, module: nn.Module, optimizers: Iterable[Any], step: int) -> None:
        """Refuses to save non-finite weights, EMA copies, or averages of the optimiser.

        Every process has to call it, because the counts are summed over ranks.

        Args:
            module: Module of the run; its parameters may be shards of this process.
            optimizers: Optimisers of the run.
            step: Optimiser steps taken so far.

        Raises:
            NotFiniteError: A number is not finite; names parts, objectives and steps.
        """
        names = {id(parameter): name for name, parameter in module.named_parameters()}
        averages = [
            (f"{names.get(id(parameter), 'optimiser')}.{key}", value)
            for optimizer in optimizers
            for parameter, state in optimizer.state.items()
            for key, value in state.items()
            if isinstance(value, Tensor)
        ]
        named = [*module.named_parameters(), *module.named_buffers(), *averages]
        bad = broken(pair for pair in named if pair[0] not in self._odd)
        # every rank raises, or none: a rank that went on alone would wait for the others for ever
        count = torch.tensor(float(len(bad)), device=named[0][1].device)
        if sum_over_ranks(count):
            # the encoder, or one head or objective
            words = [name.split(".") for name in bad]
            named_parts = {
                ".".join(w[:2]) if w[0] in ("heads", "objectives") else w[0] for w in words
            }
            parts = sorted(named_parts) or ["those of another process"]
            raise NotFiniteError(
                f"step {step}: weights are not finite ({', '.join(parts)}){self.began()}"
            )

    def began(self) -> str:
        """Message on the non-finite losses of all processes, with the first step of each.

        Every process has to call it.
        """
        if self._first is None:
            return ""
        first = self._first.clone()
        if world()[1] > 1:
            dist.all_reduce(first, op=dist.ReduceOp.MIN)
        since = dict(zip(self.keys, first.tolist(), strict=True))
        known = sorted((step, key) for key, step in since.items() if step != torch.inf)
        said = ", ".join(f"{key!r} since step {step:.0f}" for step, key in known)
        return f"; the loss is not finite: {said}" if said else "; every loss was finite"


def broken(named: Iterable[tuple[str, Tensor]]) -> list[str]:
    """Names of the tensors with a non-finite number.

    Example:
        >>> broken([("a", torch.ones(2)), ("b", torch.tensor([1.0, torch.nan]))])
        ['b']
    """
    found = {}
    for name, tensor in named:
        if tensor.is_floating_point():
            # parameters of FSDP2 are DTensors: each process checks its own share, without
            # communication
            local: Tensor = tensor.to_local() if hasattr(tensor, "to_local") else tensor
            found[name] = local.detach().isfinite().all()
    if not found:
        return []
    # all checks are started before the first result is waited for
    rows = torch.stack([flag.cpu() for flag in found.values()]).tolist()
    return [name for name, fine in zip(found, rows, strict=True) if not fine]
