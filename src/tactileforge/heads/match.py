"""The head for scores of pairs of clips."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import torch
from torch import Tensor, nn

from tactileforge.contracts import Batch, Encoder, Views
from tactileforge.util.unit import unit


@dataclass(frozen=True)
class PairScores:
    """Scores (logits) of every pair of a batch.

    Attributes:
        object: float (B, B), scores for the same object in both clips.
        action: float (B, B), scores for the same action in both clips.
    """

    object: Tensor
    action: Tensor


class MatchHead(nn.Module):
    """Linear scores of the element-wise product of two normalised class tokens.

    All pairs are one matrix product: ``w . (a * b) = (w * a) . b``. Scores start as
    ``gain * (cosine - 1)``: 0 (undecided) for equal tokens.

    Args:
        encoder: The touch encoder (given by the framework).
        gain: Fixed factor of the scores; products of unit vectors are small, so it sets the speed
            of learning.
    """

    reads: ClassVar[frozenset[str]] = frozenset({"full"})

    def __init__(self, encoder: Encoder, gain: float = 10.0) -> None:
        super().__init__()
        self.gain = gain
        self.object = nn.Linear(encoder.projected, 1)
        self.action = nn.Linear(encoder.projected, 1)
        for linear in (self.object, self.action):
            nn.init.ones_(linear.weight)
            nn.init.constant_(linear.bias, -1.0)

    def forward(self, views: Views, batch: Batch) -> PairScores:
        """Scores every pair of the batch."""
        cls = unit(views.full.cls)
        parts = (self.object, self.action)
        weight = torch.stack([part.weight for part in parts])
        bias = torch.stack([part.bias for part in parts])[..., None]
        return PairScores(*(self.gain * ((cls * weight) @ cls.T + bias)).unbind())
