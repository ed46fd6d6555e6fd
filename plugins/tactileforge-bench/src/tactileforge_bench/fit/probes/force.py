"""The probes ``force`` and ``sparsh_force``: a pooler and two layers with three outputs."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import torch
from torch import Tensor, nn

from tactileforge_bench.fit.probes.attentive import Pooler
from tactileforge_bench.fit.probes.base import SPARSH, Probe, ProbeTraining, Values
from tactileforge_bench.tasks.targets import TargetPart


class Force(Probe):
    """Two layers with a ReLU between them, nothing after them; smooth L1 with beta 0.02.

    Source: AnyTouch 2's published probe of ToucHD Bench. It is trained at a constant rate.

    Args:
        width: Size of a token.
        parts: Parts of the target: one vector.
        heads: Attention heads.
    """

    def __init__(self, width: int, parts: Mapping[str, TargetPart], heads: int = 16) -> None:
        super().__init__(width, parts)
        self.pooler = Pooler(width, heads)
        self.probe = nn.ModuleDict({k: mlp(width, part.outputs) for k, part in parts.items()})

    def forward(self, features: Tensor) -> Values:
        """(B, L, width) to (B, outputs) of each part."""
        pooled = self.pooler(features)
        return {name: head(pooled) for name, head in self.probe.items()}


class SparshForce(Force):
    """Tanh on shear, sigmoid on the normal force.

    Source: Sparsh, task T1.

    Args:
        width: Size of a token.
        parts: Parts of the target: a force.
        heads: Attention heads.
    """

    published: ClassVar[ProbeTraining] = SPARSH

    def __init__(self, width: int, parts: Mapping[str, TargetPart], heads: int = 12) -> None:
        super().__init__(width, parts, heads)

    def forward(self, features: Tensor) -> Values:
        """(B, L, width) to (B, 3) of each part."""
        return {
            name: torch.cat([out[:, :2].tanh(), out[:, 2:].sigmoid()], dim=1)
            for name, out in super().forward(features).items()
        }


def mlp(width: int, outputs: int, activation: type[nn.Module] = nn.ReLU) -> nn.Sequential:
    """Two layers, the first a quarter as wide as its input."""
    return nn.Sequential(nn.Linear(width, width // 4), activation(), nn.Linear(width // 4, outputs))
