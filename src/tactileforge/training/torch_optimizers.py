"""Optimisers of torch as plugins, with their own options; vectors have no weight decay."""

from __future__ import annotations

import re
from collections.abc import Sequence
from inspect import Parameter, getdoc, signature
from typing import Any

import torch
from torch import nn

from tactileforge.errors import ConfigError
from tactileforge.plugins import local
from tactileforge.plugins.class_contracts import OF_OPTIMIZER


class TorchOptimizer:
    """An optimiser of `torch.optim`; subclasses are made by `plugin_of`.

    Attributes:
        made: Class of torch.
    """

    made: type[torch.optim.Optimizer]

    def __init__(self, **options: Any) -> None:
        self.options = options
        # torch checks them: a slip is named before data is read
        weight = nn.Parameter(torch.zeros(1, 1))
        _check_step(self.build([("weight", weight)], False), weight)

    def build(
        self, parameters: Sequence[tuple[str, nn.Parameter]], fused: bool
    ) -> torch.optim.Optimizer:
        """Builds the optimiser with two parameter groups; see `contracts.OptimizerPlugin`.

        Raises:
            ConfigError: torch refuses an option.
        """
        groups: Any = split_by_decay(parameters, float(self.options.get("weight_decay") or 0.0))
        if "weight_decay" not in signature(self.made).parameters:
            groups = [{"params": group["params"]} for group in groups]
        options: dict[str, Any] = {
            k: tuple(v) if isinstance(v, list) else v for k, v in self.options.items()
        }
        try:
            return self.made([group for group in groups if group["params"]], **options)
        except Exception as error:  # one of the user's own raises what it likes
            own = not _is_of_torch(self.made)
            said = local.place_of(error) if own else str(error)
            raise ConfigError(f"optim: {self.made.__name__}: {said}") from error


def _check_step(optimizer: torch.optim.Optimizer, weight: nn.Parameter) -> None:
    """Raises a ConfigError if an optimiser of the user's never computes the loss of a step."""
    if _is_of_torch(type(optimizer)):
        return
    weight.grad, called = torch.zeros_like(weight), []
    try:
        # typed for a float, and torch's own take a tensor
        optimizer.step(lambda: called.append(1) or torch.zeros(()))  # type: ignore[func-returns-value,arg-type,return-value]
    except Exception as error:
        what = f"optim: {type(optimizer).__name__}.step fails on a weight of one number"
        raise ConfigError(f"{what}: {local.place_of(error)}") from error
    if not called:
        raise ConfigError(
            f"optim: {type(optimizer).__name__}.step(closure) never calls its closure, which "
            "computes the loss: begin it with loss = closure() if closure is not None else None"
        )


def _is_of_torch(made: type[torch.optim.Optimizer]) -> bool:
    return made.__module__.startswith("torch.optim")


def plugin_of(made: type[torch.optim.Optimizer]) -> type[TorchOptimizer]:
    """Plugin class of an optimiser class: the options of its constructor are those of the plugin.

    Args:
        made: Subclass of `torch.optim.Optimizer`, of torch or of the user.

    Example:
        >>> list(signature(plugin_of(torch.optim.SGD)).parameters)[:2]
        ['lr', 'momentum']
    """
    own = [
        parameter.replace(kind=Parameter.KEYWORD_ONLY, default=_plain(parameter.default))
        for name, parameter in signature(made).parameters.items()
        if name not in OF_OPTIMIZER and parameter.kind is not Parameter.VAR_KEYWORD
    ]
    doc = f"{made.__name__} of {made.__module__.partition('.')[0]}, with its options.\n\nArgs:\n"
    doc += "".join(f"    {one.name}: {_meaning(made, one.name)}\n" for one in own)
    cls = type(made.__name__, (TorchOptimizer,), {"made": made, "__doc__": doc})
    cls.__signature__ = signature(made).replace(parameters=own)  # type: ignore[attr-defined]
    return cls


def _meaning(made: type[torch.optim.Optimizer], name: str) -> str:
    """Meaning of an option, from the docstring of its class."""
    text = re.sub(r"\s+", " ", getdoc(made) or "")
    match = re.search(rf"\b{name} \([^)]*\): (.*?)(?: \(default:|\. |\w+ \([^)]*\): |$)", text)
    return match[1].strip() if match else f"see torch.optim.{made.__name__}"


def _plain(default: Any) -> Any:
    return list(default) if isinstance(default, tuple) else default


Adadelta = plugin_of(torch.optim.Adadelta)
Adafactor = plugin_of(torch.optim.Adafactor)
Adagrad = plugin_of(torch.optim.Adagrad)
Adam = plugin_of(torch.optim.Adam)
Adamax = plugin_of(torch.optim.Adamax)
ASGD = plugin_of(torch.optim.ASGD)
NAdam = plugin_of(torch.optim.NAdam)
RAdam = plugin_of(torch.optim.RAdam)
# not Rprop: it takes steps of its own, which no learning rate or schedule reaches
RMSprop = plugin_of(torch.optim.RMSprop)
SGD = plugin_of(torch.optim.SGD)


def split_by_decay(
    parameters: Sequence[tuple[str, nn.Parameter]], weight_decay: float
) -> list[dict[str, Any]]:
    """Parameter groups: matrices with decay, and vectors without.

    Args:
        parameters: Names and parameters.
        weight_decay: Decay of matrices, per step and learning rate.
    """
    # vectors are biases, gains of norms and tokens: decay to 0 would fight their own purpose
    matrices = [p for _, p in parameters if p.ndim > 1]
    vectors = [p for _, p in parameters if p.ndim <= 1]
    return [
        {"params": matrices, "weight_decay": weight_decay},
        {"params": vectors, "weight_decay": 0.0},
    ]
