"""Distils a pretrained image model: predicts its features of a touch."""

from __future__ import annotations

from typing import ClassVar

import torch
from torch import Tensor, nn

from tactileforge.contracts import Batch
from tactileforge.heads.distill import Taught
from tactileforge.objectives.r_squared import moments, r_squared


class Distill(nn.Module):
    """Squared error of the teacher's features, normalised to mean 0 and deviation 1.

    All maps have the same weight. Source: feature distillation as in Theia (Shang et al. 2024,
    section 3), with squared error alone.
    """

    head: ClassVar[str] = "distill"
    needs: ClassVar[frozenset[str]] = frozenset()

    def forward(self, prediction: Taught, batch: Batch) -> tuple[Tensor, dict[str, Tensor]]:
        """Computes the loss: the mean over maps and the whole picture of the mean error of each."""
        pairs = zip(prediction.predicted, prediction.target, strict=True)
        return torch.stack([(p.float() - t).square().mean() for p, t in pairs]).mean(), {}

    def sums(self, prediction: Taught, batch: Batch) -> Tensor:
        """Moments of maps and of the whole picture, float64 (4, 2); see `contracts.Scored`."""
        pairs = zip(prediction.predicted, prediction.target, strict=True)
        *maps, whole = (moments(predicted, target) for predicted, target in pairs)
        return torch.stack([sum(maps, torch.zeros_like(whole)), whole], 1)

    def scores(self, sums: Tensor) -> dict[str, float]:
        """R2 of the maps and of the whole picture; left out without variance."""
        names = enumerate(("r2_maps", "r2_whole"))
        scores = {name: r_squared(*sums[:, i].tolist()) for i, name in names}
        return {name: score for name, score in scores.items() if score is not None}
