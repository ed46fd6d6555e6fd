"""The objective ``markers``: displacement of printed markers at the tokens."""

from __future__ import annotations

from typing import ClassVar

import torch
from torch import Tensor, nn
from torch.nn import functional as F

from tactileforge.contracts import Batch, Column
from tactileforge.training import Mean, masked_mean


class Markers(nn.Module):
    """Squared error of the displacement of the markers, at each patch token and frame.

    The target is the track ``marker_field``, averaged or interpolated to the grid of the tokens. A
    frame without it is left out; the column follows mirrors, turns and scales of the clip.

    Args:
        deviation: Displacement that counts as 1, in percent of the picture's shorter side.
    """

    head: ClassVar[str] = "markers"
    needs: ClassVar[frozenset[str]] = frozenset()
    columns: ClassVar[tuple[Column, ...]] = (
        Column(name="marker_field", shape=(12, 12, 2), turns="field"),
    )

    def __init__(self, deviation: float = 1.0) -> None:
        super().__init__()
        self.deviation = deviation

    def forward(self, prediction: Tensor, batch: Batch) -> tuple[Mean, dict[str, Mean]]:
        """Computes the loss, averaged over labelled frames and tokens.

        Args:
            prediction: float (B, T, 2, rows, columns), percent.
            batch: Batch with the column ``marker_field``.
        """
        errors = ((prediction.float() - target(prediction, batch)) / self.deviation) ** 2
        return masked_mean(errors.mean((2, 3, 4)), batch["marker_field_valid"]), {}

    def sums(self, prediction: Tensor, batch: Batch) -> Tensor:
        """Moments along x and y, float64 (4, 2): count, sum, squares, squared errors."""
        known = batch["marker_field_valid"]
        true = target(prediction, batch)[known].double()
        error = (prediction.detach()[known].double() - true) ** 2
        parts = (torch.ones_like(true), true, true**2, error)
        return torch.stack([part.sum((0, 2, 3)) for part in parts])

    def scores(self, sums: Tensor) -> dict[str, float]:
        """R2 along x and y over all tokens and labelled frames."""
        count, total, squares, error = sums
        spread = squares - total**2 / count.clamp(min=1)
        return {
            f"r2_{axis}": 1 - float(error[i] / spread[i])
            for i, axis in enumerate("xy")
            if float(spread[i]) > 0
        }


def target(prediction: Tensor, batch: Batch) -> Tensor:
    """Displacement at the tokens, float (B, T, 2, rows, columns), percent.

    Args:
        prediction: float (B, T, 2, rows, columns), for its shape.
        batch: Batch with ``marker_field``, float32 (B, T, h, w, 2).
    """
    field: Tensor = batch["marker_field"].float().permute(0, 1, 4, 2, 3)
    size = prediction.shape[-2:]
    if field.shape[-2:] != size:
        flat = F.interpolate(field.flatten(0, 1), size, mode="bilinear", antialias=True)
        field = flat.view(*field.shape[:3], *size)
    return field
