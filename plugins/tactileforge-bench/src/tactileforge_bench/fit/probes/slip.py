"""The probe ``slip``: classifies slip and regresses the change of force (Sparsh, task T2)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import ClassVar

import torch
from torch import Tensor, nn
from torch.nn import functional as F

from tactileforge_bench.fit.probes.attentive import Pooler
from tactileforge_bench.fit.probes.base import SPARSH, Probe, ProbeTraining, Values
from tactileforge_bench.fit.probes.force import mlp
from tactileforge_bench.tasks.targets import TargetPart


class Slip(Probe):
    """A pooler and a norm for both; the change of force is limited to -1..1.

    Weighted cross-entropy, plus smooth L1 with beta 1. Source: Sparsh, task T2.

    Args:
        width: Size of a token.
        parts: Parts of the target: classes and vectors.
        heads: Attention heads.
        weights: Weights of the classes in the loss.
    """

    published: ClassVar[ProbeTraining] = SPARSH
    beta: ClassVar[float] = 1.0

    def __init__(
        self,
        width: int,
        parts: Mapping[str, TargetPart],
        heads: int = 12,
        weights: Sequence[float] = (0.1, 1.0),
    ) -> None:
        super().__init__(width, parts)
        self.weights = list(weights)
        self.pooler = Pooler(width, heads)
        self.norm = nn.LayerNorm(width)
        self.probe = nn.ModuleDict(
            {
                name: mlp(width, part.outputs, nn.Sigmoid if part.kind == "classes" else nn.ReLU)
                for name, part in parts.items()
            }
        )

    def loss_of(self, part: TargetPart, out: Tensor, truth: Tensor) -> Tensor:
        """The loss of one part, with weighted classes."""
        if part.kind != "classes":
            return super().loss_of(part, out, truth)
        weights = torch.tensor(self.weights, device=out.device)
        return F.cross_entropy(out, truth[:, 0].long(), weight=weights)

    def forward(self, features: Tensor) -> Values:
        """(B, L, width) to (B, outputs) of each part."""
        pooled = self.norm(self.pooler(features))
        out = {name: head(pooled) for name, head in self.probe.items()}
        return {
            name: value if self.parts[name].kind == "classes" else F.hardtanh(value)
            for name, value in out.items()
        }
