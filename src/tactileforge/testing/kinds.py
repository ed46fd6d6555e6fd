"""The kind of plugin of a class of the user's own."""

from __future__ import annotations

from collections.abc import Mapping
from inspect import isclass, signature
from typing import Any

import torch
from torch import nn

from tactileforge.checks import Check
from tactileforge.contracts import Dataset, Sensor
from tactileforge.errors import PluginError
from tactileforge.plugins import registry

#: Bases of kinds of plugins, and methods by which one without such a base is known.
_BASES: Mapping[str, type] = {
    "sensors": Sensor,
    "datasets": Dataset,
    "checks": Check,
    "optimizers": torch.optim.Optimizer,
}
_METHODS = {
    "sensors": ("open", "read"),
    "datasets": ("recordings",),
    "optimizers": ("build",),
    "checks": ("look", "code"),
}


def kind_of(plugin: Any, name: str = "") -> str:
    """Kind of plugin of a class of one's own, by its bases and members.

    Args:
        plugin: The class, or an instance.
        name: Name as typed, for errors.

    Returns:
        One of `registry.KINDS`.

    Raises:
        PluginError: Its kind cannot be told, or it has no conformance suite.

    Example:
        >>> from tactileforge.objectives import Pixel
        >>> kind_of(Pixel), kind_of(torch.optim.SGD)
        ('objectives', 'optimizers')
    """
    cls = plugin if isclass(plugin) else type(plugin)
    for kind, base in _BASES.items():
        if base in cls.__mro__:
            return kind
    if issubclass(cls, nn.Module):
        if any(hasattr(cls, key) for key in ("head", "needs")):
            return "objectives"
        return "heads" if "encoder" in signature(cls).parameters else "encoders"
    for kind, methods in _METHODS.items():
        if all(hasattr(cls, key) for key in methods):
            return kind
    known = ", ".join(kind.removesuffix("s") for kind in registry.KINDS)
    raise PluginError(
        f"{name or cls.__name__}: nothing tells which kind of plugin {cls.__name__} is: give "
        f"kind=, one of {known}; what is none of these has no conformance suite"
    )
