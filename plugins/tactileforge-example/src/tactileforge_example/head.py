"""A head for the share of the gel in contact."""

from __future__ import annotations

import torch
from torch import Tensor, nn

from tactileforge.contracts import Batch, Encoder, Views


class ContactAreaHead(nn.Module):
    """One number for each temporal slot, from the mean of its patches.

    Args:
        encoder: The touch encoder (passed by the framework).
    """

    def __init__(self, encoder: Encoder) -> None:
        super().__init__()
        self.norm = nn.LayerNorm(encoder.width)
        self.area = nn.Linear(encoder.width, 1)

    def forward(self, views: Views, batch: Batch) -> Tensor:
        """Predicts the contact area, float (B, slots)."""
        full = views.full
        slots = full.tokens[:, full.prefix :].chunk(full.grid[0], dim=1)
        means = torch.stack([slot.mean(1) for slot in slots], dim=1)
        area: Tensor = self.area(self.norm(means))[..., 0]
        return area
