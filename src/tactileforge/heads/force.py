"""The head that reads forces and their changes from touch."""

from __future__ import annotations

from dataclasses import dataclass

from torch import Tensor, nn

from tactileforge.contracts import Batch, Encoder, Views
from tactileforge.encoders.transformer import AttentivePooler


@dataclass(frozen=True)
class Forces:
    """Normalised forces of frames 2..T.

    Attributes:
        force: float (B, T - 1, 3), in units of the sensor's force scale.
        delta: float (B, T - 1, 3), change from the frame before, in the same units.
    """

    force: Tensor
    delta: Tensor


class ForceDecoder(nn.Module):
    """One learned query a frame reads the tokens; two layers give three numbers each."""

    def __init__(self, width: int, frames: int, heads: int) -> None:
        super().__init__()
        self.pooler = AttentivePooler(width, frames, heads)
        last = nn.Linear(width // 4, 3)
        self.probe = nn.Sequential(nn.Linear(width, width // 4), nn.ReLU(), last)
        nn.init.normal_(last.weight, std=0.02)

    def forward(self, tokens: Tensor) -> Tensor:
        """(B, L, width) to (B, frames, 3)."""
        out: Tensor = self.probe(self.pooler(tokens))
        return out


class ForceHead(nn.Module):
    """Decoders of force and of its change, on the tokens of the full view.

    Args:
        encoder: The touch encoder (given by the framework).
        heads: Attention heads; None takes one for 64 channels.
    """

    def __init__(self, encoder: Encoder, heads: int | None = None) -> None:
        super().__init__()
        heads = heads or encoder.width // 64
        self.force = ForceDecoder(encoder.width, encoder.frames - 1, heads)
        self.delta = ForceDecoder(encoder.width, encoder.frames - 1, heads)

    def forward(self, views: Views, batch: Batch) -> Forces:
        """Normalised forces of frames 2..T."""
        tokens = views.full.tokens
        return Forces(self.force(tokens), self.delta(tokens))
