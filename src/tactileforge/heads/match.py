"""The head that scores pairs of clips."""

from __future__ import annotations

from dataclasses import dataclass

from torch import Tensor, nn
from torch.nn import functional as F

from tactileforge.contracts import Batch, Encoder, Views


@dataclass(frozen=True)
class PairScores:
    """Scores (logits) of every pair of a batch.

    Attributes:
        object: float (B, B), that both touch the same object.
        action: float (B, B), that both show the same action.
    """

    object: Tensor
    action: Tensor


class MatchHead(nn.Module):
    """Linear scores of the element-wise product of two normalised class tokens.

    All pairs at once: ``w . (a * b) = (w * a) . b`` is one matrix product.

    Args:
        encoder: The touch encoder (given by the framework).
    """

    def __init__(self, encoder: Encoder) -> None:
        super().__init__()
        self.object = nn.Linear(encoder.projected, 1)
        self.action = nn.Linear(encoder.projected, 1)
        for linear in (self.object, self.action):  # starts as 5 (cosine - 1): undecided when alike
            nn.init.constant_(linear.weight, 5.0)
            nn.init.constant_(linear.bias, -5.0)

    def forward(self, views: Views, batch: Batch) -> PairScores:
        """Scores of every pair of the batch."""
        cls = F.normalize(views.full.cls, dim=-1)
        scores = [(cls * part.weight) @ cls.T + part.bias for part in (self.object, self.action)]
        return PairScores(*scores)
