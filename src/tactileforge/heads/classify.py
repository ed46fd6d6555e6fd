"""The head for classification of the touched object."""

from __future__ import annotations

from typing import ClassVar

import torch
from torch import Tensor, nn

from tactileforge.contracts import Batch, Encoder, Views
from tactileforge.util.distributed import sum_over_ranks


class ClassifyHead(nn.Module):
    """A linear layer on the projected class token.

    Args:
        encoder: The touch encoder (given by the framework).
        classes: Number of classes; see `objectives.classify.Classify`.

    Attributes:
        met: bool (classes,), True for classes seen in training.
    """

    reads: ClassVar[frozenset[str]] = frozenset({"full"})

    met: Tensor

    def __init__(self, encoder: Encoder, classes: int = 1024) -> None:
        super().__init__()
        self.linear = nn.Linear(encoder.projected, classes)
        nn.init.normal_(self.linear.weight, std=0.02)
        nn.init.zeros_(self.linear.bias)
        self.register_buffer("met", torch.zeros(classes, dtype=torch.bool))

    def forward(self, views: Views, batch: Batch) -> Tensor:
        """Computes logits, float (B, classes)."""
        if self.training:
            known = batch["object"] >= 0
            count = torch.zeros_like(self.met, dtype=torch.int64)
            # a class is the hash of an object's name, modulo their number: `objectives.classify`
            count.index_add_(0, batch["object"].remainder(len(count)), known.long())
            self.met |= sum_over_ranks(count) > 0  # a buffer must not differ between processes
        out: Tensor = self.linear(views.full.cls)
        return out
