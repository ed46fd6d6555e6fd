"""Predicts what a pretrained image model sees in a touch."""

from __future__ import annotations

from typing import ClassVar

import torch
from torch import Tensor, nn

from tactileforge.contracts import Batch
from tactileforge.heads.distill import Taught


class Distill(nn.Module):
    """Squared error of the teacher's features, of mean 0 and deviation 1; all maps count alike.

    Source: feature distillation as in Theia (Shang et al. 2024, section 3), by squared error alone.
    """

    head: ClassVar[str] = "distill"
    needs: ClassVar[frozenset[str]] = frozenset()

    def forward(self, prediction: Taught, batch: Batch) -> tuple[Tensor, dict[str, Tensor]]:
        """The loss: the mean over maps and the whole picture of the mean error of each."""
        pairs = zip(prediction.predicted, prediction.target, strict=True)
        return torch.stack([(p.float() - t).square().mean() for p, t in pairs]).mean(), {}

    def sums(self, prediction: Taught, batch: Batch) -> Tensor:
        """Moments of maps and of the whole picture, float64 (4, 2); see `contracts.Scored`."""
        *maps, whole = zip(prediction.predicted, prediction.target, strict=True)
        return torch.stack([_moments(maps), _moments([whole])], 1)

    def scores(self, sums: Tensor) -> dict[str, float]:
        """R2 of the maps and of the whole picture; one without variance is left out."""
        count, total, square, error = sums
        variance = square / count - (total / count) ** 2
        return {
            f"r2_{name}": 1 - float(error[i] / count[i] / variance[i])
            for i, name in enumerate(("maps", "whole"))
            if count[i] and variance[i] > 1e-12
        }


def _moments(pairs: list[tuple[Tensor, Tensor]]) -> Tensor:
    """Count, sum, sum of squares and squared error, float64 (4,)."""
    out = torch.zeros(4, dtype=torch.float64)
    for predicted, target in pairs:
        true, error = target.double(), predicted.detach().double() - target.double()
        parts = (torch.ones_like(true), true, true**2, error**2)
        out = out.to(true.device) + torch.stack([part.sum() for part in parts])
    return out
