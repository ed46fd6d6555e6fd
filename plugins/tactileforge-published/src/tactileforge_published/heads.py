"""Heads published by authors beside their encoders, in the layout of their weights."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import torch
from torch import Tensor, nn

from tactileforge.contracts import Batch, Encoder, Views
from tactileforge.encoders import AttentivePooler
from tactileforge.heads import ForceDecoder, Forces

#: Attention heads of the published probes of AnyTouch 2.
_HEADS = 16
#: Widths of the hidden layers of FeelAnyForce's head.
_REGRESSOR = (512, 256, 128, 64)


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


def regressor_decoder(width: int) -> nn.Sequential:
    """Five layers to three numbers, (B, width) to (B, 3), with norms and GELU between them.

    Source: the layout of FeelAnyForce's weights.
    """
    layers: list[nn.Module] = []
    for given, out in pairwise((width, *_REGRESSOR)):
        layers += [nn.Linear(given, out), nn.LayerNorm(out), nn.GELU()]
    return nn.Sequential(*layers, nn.Linear(_REGRESSOR[-1], 3))


class PublishedRegressor(nn.Module):
    """The force head of FeelAnyForce: the three forces of the newest frame, from its class vector.

    The file predicts newton along the axes of the authors' force sensor, z positive in presses.

    Args:
        encoder: The touch encoder (given by the framework).
        scale: Force that counts as 1, N; the paper's forces go up to 15 N.
    """

    def __init__(self, encoder: Encoder, scale: float = 15.0) -> None:
        super().__init__()
        self.decoder = regressor_decoder(encoder.projected)
        self.scale = scale

    def forward(self, views: Views, batch: Batch) -> Forces:
        """Predicts normalised forces of the newest frame, (B, 1, 3), but not their changes."""
        force = self.decoder(views.full.cls)[:, None] / self.scale
        return Forces(force, torch.zeros_like(force))

    def hidden(self, views: Views) -> Tensor:
        """Input of the last layer, float (B, 1, 64)."""
        out: Tensor = self.decoder[:-1](views.full.cls)
        return out[:, None]
