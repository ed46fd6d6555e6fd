"""The probe ``pose``: three motions in eleven classes each (Sparsh, task T3)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import torch
from torch import Tensor
from torch.nn import functional as F

from tactileforge_bench.fit.probes.attentive import Attentive
from tactileforge_bench.fit.probes.base import SPARSH, ProbeTraining, class_scores
from tactileforge_bench.tasks.targets import TargetPart


class Pose(Attentive):
    """A pooler, and a linear layer for all motions; classes are weighted by their rarity.

    Sparsh weights the classes, and does not publish how: here a class weighs the inverse of its
    share, limited to ten times the mean, and each motion has weights of its own.

    Args:
        width: Size of a token.
        parts: Parts of the target: columns of classes.
        heads: Attention heads.
    """

    published: ClassVar[ProbeTraining] = SPARSH

    def __init__(self, width: int, parts: Mapping[str, TargetPart], heads: int = 12) -> None:
        super().__init__(width, parts, heads)
        self.weights = {name: _weights(part) for name, part in parts.items()}

    def loss_of(self, part: TargetPart, out: Tensor, truth: Tensor) -> Tensor:
        """Mean of the weighted cross-entropies of the columns."""
        # the loss is asked for by part, and weights are kept by name
        name = next(key for key, value in self.parts.items() if value is part)
        weights, logits = self.weights[name].to(out.device), class_scores(part, out)
        losses = [
            F.cross_entropy(logits[:, i], truth[:, i].long(), weight=weight)
            for i, weight in enumerate(weights)
        ]
        return torch.stack(losses).mean()


def _weights(part: TargetPart) -> Tensor:
    """(columns, classes)."""
    count = len(part.names)
    histograms = [column.long().bincount(minlength=count) for column in part.truth.T]
    rare = [len(part.truth) / (count * counts.clamp(min=1)) for counts in histograms]
    return torch.stack(rare).clamp(max=10)
