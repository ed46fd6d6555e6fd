"""The optimiser and its schedule."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import torch
from torch import nn


@dataclass(frozen=True, kw_only=True)
class OptimOptions:
    """The keys of ``optim``.

    Attributes:
        lr: Learning rate, after the warm-up.
        weight_decay: Of matrices.
        betas: Of AdamW.
        warmup: Share of the run in which the learning rate rises.
        clip: Largest norm of the gradient; None for any.
    """

    lr: float
    weight_decay: float
    betas: tuple[float, float]
    warmup: float
    clip: float | None = None


def optimiser(
    parameters: Iterable[nn.Parameter],
    config: Mapping[str, Any],
    total: int,
    fused: bool = True,
) -> dict[str, Any]:
    """AdamW without decay of vectors; linear warm-up, then linear decay to 0.

    Args:
        parameters: Those that need no gradient are left out.
        config: ``lr``, ``weight_decay``, ``betas``, and ``warmup``, the share of the run in which
            the learning rate rises.
        total: Steps of the run.
        fused: Whether all of a step is one kernel; not with a scaler of gradients, which hides from
            clipping how large they are.

    Returns:
        What `LightningModule.configure_optimizers` gives.
    """
    matrices: list[nn.Parameter] = []
    vectors: list[nn.Parameter] = []
    for parameter in parameters:
        if parameter.requires_grad:
            (matrices if parameter.ndim > 1 else vectors).append(parameter)
    optimizer = torch.optim.AdamW(
        [
            {"params": matrices, "weight_decay": config["weight_decay"]},
            {"params": vectors, "weight_decay": 0.0},
        ],
        lr=config["lr"],
        betas=tuple(config["betas"]),
        fused=fused,
    )
    warm = max(1, round(config["warmup"] * total))
    schedule = torch.optim.lr_scheduler.LambdaLR(
        optimizer,
        lambda step: min((step + 1) / warm, (total - step) / max(1, total - warm + 1)),
    )
    return {"optimizer": optimizer, "lr_scheduler": {"scheduler": schedule, "interval": "step"}}


def set_rate(schedule: torch.optim.lr_scheduler.LambdaLR) -> None:
    """Sets the learning rate to that of the schedule's step, which a checkpoint may not have had.

    Args:
        schedule: Of `optimiser`.
    """
    groups = zip(
        schedule.optimizer.param_groups, schedule.base_lrs, schedule.lr_lambdas, strict=True
    )
    for group, rate, factor in groups:
        group["lr"] = rate * factor(schedule.last_epoch)
