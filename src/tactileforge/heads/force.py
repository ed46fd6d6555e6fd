"""The head for prediction of forces and their changes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Literal

import torch
from torch import Tensor, nn

from tactileforge.contracts import Batch, Encoder, Features, Views
from tactileforge.encoders.transformer import AttentivePooler, attention_heads
from tactileforge.errors import ConfigError
from tactileforge.heads.decoder import check_moving


@dataclass(frozen=True)
class Forces:
    """Normalised forces of frames 2..T.

    Attributes:
        force: float (B, T - 1, 3), in units of the sensor's force scale.
        delta: float (B, T - 1, 3), change from the previous frame, in the same units.
    """

    force: Tensor
    delta: Tensor


class ForceDecoder(nn.Module):
    """An attentive pooler with one learned query per frame, and two layers to three numbers."""

    def __init__(self, width: int, frames: int, heads: int) -> None:
        super().__init__()
        self.pooler = AttentivePooler(width, frames, heads)
        last = nn.Linear(width // 4, 3)
        self.probe = nn.Sequential(nn.Linear(width, width // 4), nn.ReLU(), last)
        # a small last layer starts near no force, as most labels are
        nn.init.normal_(last.weight, std=0.02)

    def hidden(self, tokens: Tensor) -> Tensor:
        """Input of the last layer, (B, frames, width / 4)."""
        out: Tensor = self.probe[:-1](self.pooler(tokens))
        return out

    def forward(self, tokens: Tensor) -> Tensor:
        """Predicts forces: (B, L, width) to (B, frames, 3)."""
        out: Tensor = self.probe[-1](self.hidden(tokens))
        return out


class MeanReadout(nn.Module):
    """One linear layer on the mean of the patch tokens.

    Features usable by it are usable by any linear probe of pooled features.
    """

    def __init__(self, width: int, frames: int, prefix: int) -> None:
        super().__init__()
        self.frames, self.prefix = frames, prefix
        self.linear = nn.Linear(width, 3 * frames)
        # starts near no force, as above
        nn.init.normal_(self.linear.weight, std=0.01)
        nn.init.zeros_(self.linear.bias)

    def hidden(self, tokens: Tensor) -> Tensor:
        """Input of the layer, (B, frames, width): the same for every frame."""
        return tokens[:, self.prefix :].mean(1, keepdim=True).expand(-1, self.frames, -1)

    def forward(self, tokens: Tensor) -> Tensor:
        """Predicts forces: (B, L, width) to (B, frames, 3)."""
        out: Tensor = self.linear(self.hidden(tokens)[:, 0])
        return out.view(-1, self.frames, 3)


class ForceHead(nn.Module):
    """Decoders of force and of its change, on the tokens of the full view.

    Args:
        encoder: The touch encoder (given by the framework).
        heads: Number of attention heads; None takes about one per 64 channels, see
            `attention_heads`.
        difference: Whether to add the differences of the patch tokens of each later slot to those
            of the first as further tokens: shear moves the image, a normal press does not.
        readout: Kind of decoder: ``attention``, as in the paper, or ``mean``, see `MeanReadout`.

    Raises:
        ConfigError: ``difference`` is set, and the encoder has one temporal slot or the readout is
            ``mean``.
    """

    reads: ClassVar[frozenset[str]] = frozenset({"full"})

    def __init__(
        self,
        encoder: Encoder,
        heads: int | None = None,
        difference: bool = False,
        readout: Literal["attention", "mean"] = "attention",
    ) -> None:
        super().__init__()
        heads = heads or attention_heads(encoder.width)
        check_moving(encoder, "force")
        frames = encoder.frames - 1
        self.force, self.delta = (
            ForceDecoder(encoder.width, frames, heads)
            if readout == "attention"
            else MeanReadout(encoder.width, frames, encoder.prefix)
            for _ in range(2)
        )
        self.width = encoder.width
        self.difference = difference
        if difference:
            if readout == "mean":
                raise ConfigError(
                    "head.force.difference adds tokens, which a mean would mix with the others: "
                    "give head.force.readout=attention"
                )
            if encoder.grid[0] < 2:
                raise ConfigError(
                    "head.force.difference compares temporal slots, and the encoder has one: give "
                    "encoder.frames of at least twice encoder.tube"
                )
            self.norm = nn.LayerNorm(encoder.width)

    def forward(self, views: Views, batch: Batch) -> Forces:
        """Predicts normalised forces of frames 2..T."""
        tokens = self._tokens(views.full)
        return Forces(self.force(tokens), self.delta(tokens))

    def hidden(self, views: Views) -> Tensor:
        """Input of the last layer of the forces, float (B, T - 1, width or width / 4)."""
        out: Tensor = self.force.hidden(self._tokens(views.full))
        return out

    def _tokens(self, full: Features) -> Tensor:
        if not self.difference:
            return full.tokens
        slots, rows, columns = full.grid
        patches = full.tokens[:, full.prefix :].reshape(-1, slots, rows * columns, self.width)
        # against the first slot: what has changed since the clip began
        changes = (patches[:, 1:] - patches[:, :1]).flatten(1, 2)
        return torch.cat([full.tokens, self.norm(changes)], dim=1)
