"""Optimisers and schedules of the learning rate: plugins, and those of the package."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any, TypeAlias

import torch
from torch import nn

from tactileforge.contracts import OptimizerPlugin
from tactileforge.errors import ConfigError, check_names, unknown
from tactileforge.plugins import local, registry
from tactileforge.training.torch_optimizers import plugin_of, split_by_decay
from tactileforge.util import strict

#: Factor of the learning rate, given the step, the steps of the warm-up, and those of the run.
Schedule: TypeAlias = Callable[[int, int, int], float]


@dataclass(frozen=True, kw_only=True)
class OptimOptions:
    """Keys of ``optim`` common to all optimisers; the others are those of the constructor.

    Attributes:
        warmup: Share of the run with a rising learning rate, 0 to 1.
        schedule: Name of a `Schedule`.
        clip: Largest norm of the gradient; None for no clipping.
        layer_decay: Factor of the learning rate of a block of the encoder for each block above it,
            as in fine-tuning after MAE (He et al., 2022: .65 to .75); 1 for one rate.
        rates: Factors of the learning rate by the beginning of parameters' names, the longest one
            that fits: ``{encoder: 0.1, heads.force: 2}``; others keep the rate. None for one rate.
    """

    warmup: float = 0.025
    schedule: str = "linear"
    clip: float | None = 1.0
    layer_decay: float = 1.0
    rates: Mapping[str, float] | None = None

    def __post_init__(self) -> None:
        if not 0 <= self.warmup <= 1:
            raise ConfigError(f"optim.warmup={self.warmup}: give a share of the run, 0 to 1")
        if self.clip is not None and not self.clip > 0:
            raise ConfigError(f"optim.clip={self.clip}: give a norm above 0, or null to clip none")
        if not 0 < self.layer_decay <= 1:
            raise ConfigError(f"optim.layer_decay={self.layer_decay}: give above 0, up to 1")
        for name, factor in (self.rates or {}).items():
            if not 0 < factor < math.inf:
                raise ConfigError(f"optim.rates.{name}={factor}: give a factor above 0")
        if local.is_local(self.schedule):
            _check_own_schedule(self.schedule)
        elif self.schedule not in registry.names("schedules"):
            raise ConfigError(unknown("optim.schedule", self.schedule, registry.names("schedules")))


def _check_own_schedule(name: str) -> None:
    """Calls a schedule of the user's own once.

    Raises:
        ConfigError: It is a class, as those of torch are, or takes or returns something else.
    """
    factor = registry.load("schedules", name)
    fix = (
        "give a function of the step, the steps of the warm-up and those of the run, which returns "
        "the factor of the rate: def flat(step, warm, total): return 1.0"
    )
    if isinstance(factor, type):
        raise ConfigError(f"optim.schedule={name} is a class; {fix}")
    try:
        float(factor(0, 1, 2))
    except (TypeError, ValueError) as error:
        raise ConfigError(f"optim.schedule={name}: {error}; {fix}") from error


COMMON = {field.name: field.default for field in fields(OptimOptions)}


def check_optim(config: Mapping[str, Any]) -> None:
    """Checks the keys of an optimiser; arguments and errors are those of `parse_optim`."""
    own = {key: value for key, value in config.items() if key not in COMMON}
    name = str(own.pop("name", "adamw"))
    made = registry.get("optimizers", name)
    if isinstance(made, type) and issubclass(made, torch.optim.Optimizer):  # a local class
        made = plugin_of(made)
    check_names(f"option of optimizer {name!r}", own, {*registry.parameters(made), *COMMON})


def parse_optim(config: Mapping[str, Any]) -> tuple[OptimizerPlugin, OptimOptions]:
    """Builds the optimiser plugin of a configuration.

    Args:
        config: Configuration: ``name`` (``adamw`` without one), the keys of `OptimOptions`, and the
            options of the plugin.

    Raises:
        ConfigError: An unknown key, or a value out of range.
        PluginError: The optimiser or schedule is not installed.
    """
    own = {key: value for key, value in config.items() if key not in COMMON}
    common = {key: value for key, value in config.items() if key in COMMON}
    named = {"name": "adamw", **own}
    made = registry.get("optimizers", str(named["name"]))
    if isinstance(made, type) and issubclass(made, torch.optim.Optimizer):  # a local class
        options = {key: value for key, value in named.items() if key != "name"}
        what = f"option of optimizer {named['name']!r}"
        check_names(what, options, registry.parameters(plugin_of(made)))
        registry.check_types("optim.", made, options)
        plugin: OptimizerPlugin = plugin_of(made)(**options)
    else:
        plugin = registry.build("optimizers", named, "optim")
    return plugin, strict.build(OptimOptions, "optim", common)


def build_optimizer(
    parameters: Iterable[tuple[str, nn.Parameter]],
    config: Mapping[str, Any],
    total: int,
    fused: bool = True,
) -> dict[str, Any]:
    """Builds an optimiser and its schedule, as ``configure_optimizers`` returns them.

    Args:
        parameters: Names and parameters; those that need no gradient are left out.
        config: Configuration of the optimiser; see `parse_optim`.
        total: Steps of the run.
        fused: Whether a step may be one kernel; False with a gradient scaler, because clipping
            would then see scaled gradients.
    """
    plugin, options = parse_optim(config)
    # frozen parameters would have averages in every checkpoint, and decay without a gradient
    learned = [(name, one) for name, one in parameters if one.requires_grad]
    optimizer = plugin.build(learned, fused)
    if options.layer_decay < 1:
        _scale_rates(optimizer, _by_layer(learned, options.layer_decay))
    if options.rates:
        _scale_rates(optimizer, _by_name(learned, options.rates))
    warm = max(1, round(options.warmup * total))
    factor: Schedule = registry.load("schedules", options.schedule)
    schedule = torch.optim.lr_scheduler.LambdaLR(optimizer, lambda step: factor(step, warm, total))
    return {"optimizer": optimizer, "lr_scheduler": {"scheduler": schedule, "interval": "step"}}


#: Number of a block in the name of a parameter of an encoder.
_BLOCK = re.compile(r"^encoder\..*?\b(?:blocks|layers|stages|features)\.(\d+)\.")


def _by_layer(
    learned: Sequence[tuple[str, nn.Parameter]], decay: float
) -> dict[nn.Parameter, float]:
    """Factors by block of the encoder; parameters below the blocks have the smallest one."""
    blocks = {name: _BLOCK.match(name) for name, _ in learned}
    depth = 1 + max((int(match[1]) for match in blocks.values() if match), default=-1)
    factors = {}
    for name, parameter in learned:
        match, is_encoder = blocks[name], name.startswith("encoder.")
        above = depth - int(match[1]) if match else depth + 1 if is_encoder else 0
        # norms and projections behind the blocks keep the whole rate
        above = 0 if is_encoder and not match and re.search(r"\b(norm|proj|pool)", name) else above
        factors[parameter] = decay**above
    return factors


def _by_name(
    learned: Sequence[tuple[str, nn.Parameter]], rates: Mapping[str, float]
) -> dict[nn.Parameter, float]:
    """Factors by the longest beginning of a parameter's name.

    Raises:
        ConfigError: No parameter that learns has such a name.
    """
    factors, used = dict[nn.Parameter, float](), set[str]()
    for name, parameter in learned:
        fitting = [one for one in rates if name == one or name.startswith(f"{one}.")]
        longest = max(fitting, key=len, default=None)
        used.update(fitting)
        factors[parameter] = 1.0 if longest is None else rates[longest]
    for unused in rates.keys() - used:
        parts = {".".join(name.split(".")[:count]) for name, _ in learned for count in (1, 2)}
        raise ConfigError(unknown("optim.rates", unused, sorted(parts)))
    return factors


def _scale_rates(optimizer: torch.optim.Optimizer, factors: Mapping[nn.Parameter, float]) -> None:
    """Splits the parameter groups by the factors of their rates."""
    groups = []
    for group in optimizer.param_groups:
        for factor in sorted({factors[one] for one in group["params"]}, reverse=True):
            ours = [one for one in group["params"] if factors[one] == factor]
            groups.append({**group, "params": ours, "lr": group["lr"] * factor})
    optimizer.param_groups = groups


class AdamW:
    """AdamW without decay of vectors (Loshchilov and Hutter, 2019).

    Args:
        lr: Learning rate after the warm-up.
        weight_decay: Decay of matrices, per step and learning rate.
        betas: Shares kept at each step of the average gradient and of the average squared gradient,
            0 or more, below 1.
    """

    # decay and betas as in the pre-training of MAE (He et al., 2022, table 8)
    def __init__(
        self,
        lr: float = 3e-4,
        weight_decay: float = 0.05,
        betas: tuple[float, float] = (0.9, 0.95),
    ) -> None:
        if not all(0 <= rate < math.inf for rate in (lr, weight_decay)):
            raise ConfigError(f"optim.lr={lr}, optim.weight_decay={weight_decay}: give 0 or more")
        if len(betas) != 2 or not all(0 <= beta < 1 for beta in betas):
            raise ConfigError(f"optim.betas={list(betas)}: give two of 0 or more, below 1")
        self.lr, self.weight_decay, self.betas = lr, weight_decay, (betas[0], betas[1])

    def build(
        self, parameters: Sequence[tuple[str, nn.Parameter]], fused: bool
    ) -> torch.optim.Optimizer:
        """Builds AdamW with its two parameter groups; see `contracts.OptimizerPlugin`."""
        groups = split_by_decay(parameters, self.weight_decay)
        return torch.optim.AdamW(groups, lr=self.lr, betas=self.betas, fused=fused)


def set_rate(schedule: torch.optim.lr_scheduler.LambdaLR) -> None:
    """Sets the learning rate of the schedule's current step.

    The rate in a checkpoint is that of the old length of the run, and a resumed run may have
    another length.

    Args:
        schedule: Schedule made by `build_optimizer`.
    """
    groups = zip(
        schedule.optimizer.param_groups, schedule.base_lrs, schedule.lr_lambdas, strict=True
    )
    for group, rate, factor in groups:
        # LambdaLR sets rates in step() alone, and the next step would still use the old one
        group["lr"] = rate * factor(schedule.last_epoch)
