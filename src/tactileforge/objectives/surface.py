"""Predicts the displacement of the gel's surface."""

from __future__ import annotations

from typing import ClassVar

import torch
from torch import Tensor, nn

from tactileforge.contracts import AXES, Batch
from tactileforge.data.labels import displacement
from tactileforge.objectives.r_squared import moments, r_squared
from tactileforge.util.distributed import masked_mean
from tactileforge.util.means import Mean


class Surface(nn.Module):
    """Squared error of the surface's displacement along x, y and z, coded as a square root.

    Each axis is divided by its deviation over simulated touches, so that shear has the same weight
    as depth. A clip without a known surface is left out.

    Args:
        deviation: Deviation of the coded displacement along x, y and z.
    """

    head: ClassVar[str] = "surface"
    needs: ClassVar[frozenset[str]] = frozenset({"surface"})
    deviation: Tensor

    def __init__(self, deviation: tuple[float, float, float] = (0.23, 0.23, 0.12)) -> None:
        super().__init__()
        scale = torch.tensor(list(deviation)).view(3, 1, 1)
        self.register_buffer("deviation", scale, persistent=False)

    def forward(self, prediction: Tensor, batch: Batch) -> tuple[Mean, dict[str, Mean]]:
        """Computes the loss, averaged over frames and positions."""
        true = displacement.coded_displacement(batch["surface"])
        errors = ((prediction.float() - true) / self.deviation) ** 2
        return masked_mean(errors.mean((1, 2, 3, 4)), batch["surface_valid"]), {}

    def sums(self, prediction: Tensor, batch: Batch) -> Tensor:
        """Moments of each axis, float64 (4, 3); see `contracts.Scored`."""
        true = displacement.coded_displacement(batch["surface"])
        known = batch["surface_valid"].view(-1, 1, 1, 1, 1)
        return moments(prediction, true, (0, 1, 3, 4), known)

    def scores(self, sums: Tensor) -> dict[str, float]:
        """R2 along each axis over all positions and clips."""
        scores = {f"r2_{axis}": r_squared(*sums[:, i].tolist()) for i, axis in enumerate(AXES)}
        return {name: score for name, score in scores.items() if score is not None}
