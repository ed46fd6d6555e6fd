"""The head for prediction of the displacement of the gel's surface."""

from __future__ import annotations

from typing import ClassVar

import torch
from torch import Tensor, nn
from torch.nn import functional as F

from tactileforge.contracts import Batch, Encoder, Views
from tactileforge.data.labels.displacement import SHAPE


class SurfaceHead(nn.Module):
    """One linear layer from each patch token to the displacement of the surface below the patch.

    As the head is linear, the tokens have to carry the displacement in a form usable by any other
    linear layer.

    If patches do not divide the image of the surface, whole cells below each are resampled.

    Args:
        encoder: The touch encoder (given by the framework).
    """

    reads: ClassVar[frozenset[str]] = frozenset({"full"})

    def __init__(self, encoder: Encoder) -> None:
        super().__init__()
        self.grid, self.prefix, self.tube = encoder.grid, encoder.prefix, encoder.tube
        _, rows, columns = self.grid
        # a token predicts the part of the surface below its patch
        self.cell = max(1, round(SHAPE[0] / rows)), max(1, round(SHAPE[1] / columns))
        self.linear = nn.Linear(encoder.width, self.tube * 3 * self.cell[0] * self.cell[1])
        nn.init.normal_(self.linear.weight, std=0.01)
        nn.init.zeros_(self.linear.bias)

    def forward(self, views: Views, batch: Batch) -> Tensor:
        """Predicts coded displacements from -1 to 1 of all frames, float (B, T, 3, 32, 32)."""
        slots, rows, columns = self.grid
        x: Tensor = self.linear(views.full.tokens[:, self.prefix :])
        x = x.view(-1, slots, rows, columns, self.tube, 3, *self.cell)
        x = x.permute(0, 1, 4, 5, 2, 6, 3, 7)
        x = torch.reshape(x, (-1, 3, rows * self.cell[0], columns * self.cell[1]))
        # a grid that does not divide the surface has cells of another size
        if x.shape[2:] != SHAPE:
            x = F.interpolate(x, SHAPE, mode="bilinear", align_corners=False)
        return x.view(-1, slots * self.tube, 3, *SHAPE)
