"""Heads that authors publish beside their encoders, as their weights are laid out."""

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
    """The force head of AnyTouch 2: one query reads all tokens, and gives the newest force.

    It predicts (Fx, Fy, -Fz) of its data; columns and signs turn these into x to the right of the
    image, y down, z into the gel. Source: AnyTouch 2, probes of ToucHD Bench, and their weights.

    Args:
        encoder: The touch encoder (given by the framework); 16 divides its width.
        columns: Which of its outputs is x, y, z.
        signs: By which each of these is multiplied.
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
        """Normalised forces of the newest frame, (B, 1, 3); their changes are not predicted."""
        force = self.decoder(views.full.tokens)[..., self.columns] * self.signs
        return Forces(force, torch.zeros_like(force))


class PublishedProbe(nn.Module):
    """The attentive probe of AnyTouch 2 for classes, as of Cloth.

    Args:
        encoder: The touch encoder (given by the framework); 16 divides its width.
        classes: Number of classes.
    """

    def __init__(self, encoder: Encoder, classes: int = 20) -> None:
        super().__init__()
        self.pooler = AttentivePooler(encoder.width, 1, _HEADS)
        self.linear = nn.Linear(encoder.width, classes)

    def forward(self, views: Views, batch: Batch) -> Tensor:
        """Logits, float (B, classes)."""
        out: Tensor = self.linear(self.pooler(views.full.tokens)[:, 0])
        return out
