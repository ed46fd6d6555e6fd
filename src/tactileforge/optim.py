"""The optimiser and its schedule."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import torch
from torch import nn

from tactileforge.errors import ConfigError, unknown


def _linear(step: int, warm: int, total: int) -> float:
    return max(0.0, min((step + 1) / warm, (total - step) / max(1, total - warm + 1)))


def _cosine(step: int, warm: int, total: int) -> float:
    if step < warm:
        return step / warm
    return max(0.0, 0.5 * (1.0 + math.cos(math.pi * (step - warm) / max(1, total - warm))))


def _constant(step: int, warm: int, total: int) -> float:
    return min(1.0, step / warm)


#: Factor of the learning rate of each schedule, given the step, those of the warm-up, and all.
_SCHEDULES: dict[str, Callable[[int, int, int], float]] = {
    "linear": _linear,
    "cosine": _cosine,
    "constant": _constant,
}


@dataclass(frozen=True, kw_only=True)
class OptimOptions:
    """The keys of ``optim``.

    Attributes:
        lr: Learning rate, after the warm-up.
        weight_decay: Of matrices.
        betas: Of AdamW.
        warmup: Share of the run in which the learning rate rises.
        clip: Largest norm of the gradient; None for any.
        schedule: Course of the learning rate after the warm-up: ``linear`` or ``cosine`` to 0, or
            ``constant``.
    """

    lr: float
    weight_decay: float
    betas: tuple[float, float]
    warmup: float
    clip: float | None = None
    schedule: str = "linear"

    def __post_init__(self) -> None:
        rates = (self.lr, self.weight_decay)
        if not all(0 <= rate < math.inf for rate in rates) or not 0 <= self.warmup <= 1:
            raise ConfigError(
                f"optim.lr={self.lr}, optim.weight_decay={self.weight_decay}, "
                f"optim.warmup={self.warmup}: none may be below 0, nor a share above 1"
            )
        if not all(0 <= beta < 1 for beta in self.betas):
            raise ConfigError(f"optim.betas={list(self.betas)}: give 0 or more, below 1")
        if self.clip is not None and not self.clip > 0:
            raise ConfigError(f"optim.clip={self.clip}: give a norm above 0, or null to clip none")


def optimiser(
    parameters: Iterable[nn.Parameter],
    config: Mapping[str, Any],
    total: int,
    fused: bool = True,
) -> dict[str, Any]:
    """AdamW without decay of vectors; linear warm-up, then a decay of the learning rate.

    Args:
        parameters: Those that need no gradient are left out.
        config: See `OptimOptions`.
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
    name = config.get("schedule", "linear")
    if name not in _SCHEDULES:
        raise ConfigError(unknown("optim.schedule", name, _SCHEDULES))
    factor = _SCHEDULES[name]
    schedule = torch.optim.lr_scheduler.LambdaLR(optimizer, lambda step: factor(step, warm, total))
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
