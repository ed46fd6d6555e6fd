"""The head that names what is touched."""

from __future__ import annotations

from torch import Tensor, nn

from tactileforge.contracts import Batch, Encoder, Views


class ClassifyHead(nn.Module):
    """A linear layer on the projected class token.

    Args:
        encoder: The touch encoder (given by the framework).
        classes: Number of classes; see `objectives.classify.Classify`.
    """

    def __init__(self, encoder: Encoder, classes: int = 1024) -> None:
        super().__init__()
        self.linear = nn.Linear(encoder.projected, classes)
        nn.init.normal_(self.linear.weight, std=0.02)
        nn.init.zeros_(self.linear.bias)

    def forward(self, views: Views, batch: Batch) -> Tensor:
        """Logits, float (B, classes)."""
        out: Tensor = self.linear(views.full.cls)
        return out
