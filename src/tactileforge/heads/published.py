"""Heads published by authors beside their encoders, in the layout of their weights."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor, nn

from tactileforge.contracts import Batch, Encoder, Views
from tactileforge.encoders.transformer import AttentivePooler
from tactileforge.heads.force import ForceDecoder, Forces

#: Attention heads of the published probes of AnyTouch 2.
_HEADS = 16


class PublishedForce(nn.Module):
    """The force head of AnyTouch 2: one query on all tokens predicts the newest force.

    It predicts (Fx, Fy, -Fz) of its data; columns and signs turn these into x to the right of the
    image, y down, z into the gel. Source: AnyTouch 2, probes of ToucHD Bench, and their weights.

    Args:
        encoder: The touch encoder (given by the framework), with a width divisible by 16.
        columns: Output columns of x, y and z.
        signs: Factors of x, y and z.
    """

    def __init__(
        self,
        encoder: Encoder,
        columns: Sequence[int] = (0, 1, 2),
        signs: Sequence[float] = (1.0, 1.0, 1.0),
    ) -> None:
        super().__init__()
        self.decoder = ForceDecoder(encoder.width, 1, _HEADS)
        self.columns = list(columns)
        self.register_buffer("signs", torch.tensor(list(signs)), persistent=False)
        self.signs: Tensor

    def forward(self, views: Views, batch: Batch) -> Forces:
        """Predicts normalised forces of the newest frame, (B, 1, 3), but not their changes."""
        force = self.decoder(views.full.tokens)[..., self.columns] * self.signs
        return Forces(force, torch.zeros_like(force))


class PublishedProbe(nn.Module):
    """The attentive probe of AnyTouch 2 for classes, for example of Cloth.

    Args:
        encoder: The touch encoder (given by the framework), with a width divisible by 16.
        classes: Number of classes.
    """

    def __init__(self, encoder: Encoder, classes: int = 20) -> None:
        super().__init__()
        self.pooler = AttentivePooler(encoder.width, 1, _HEADS)
        self.linear = nn.Linear(encoder.width, classes)

    def forward(self, views: Views, batch: Batch) -> Tensor:
        """Computes logits, float (B, classes)."""
        out: Tensor = self.linear(self.pooler(views.full.tokens)[:, 0])
        return out
