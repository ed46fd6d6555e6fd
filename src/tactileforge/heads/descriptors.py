"""The head that reads descriptors of a touch from every patch token and from the class token."""

from __future__ import annotations

from dataclasses import dataclass

from torch import Tensor, nn

from tactileforge.contracts import Batch, Encoder, Views
from tactileforge.data.labels.descriptors import Descriptors
from tactileforge.distributed import rand_rows


@dataclass(frozen=True)
class DescribedTouch:
    """Descriptors as they are read, each in units of its deviation, less its mean.

    Attributes:
        tokens: float (B, L, n), from each patch token.
        cls: float (B, n), from the projected class token.
        true: Those of the batch.
    """

    tokens: Tensor
    cls: Tensor
    true: Descriptors


class DescriptorsHead(nn.Module):
    """One linear layer on each patch token, and one on the projected class token.

    Every token tells of the whole touch, so the mean of the tokens does too, and any linear reading
    of it. In training, noise is added to the tokens: what is to be read must then stand out in
    them, and not lie in directions of little variance, which a probe fitted on few clips misses.

    Args:
        encoder: The touch encoder (given by the framework).
        noise: Deviation of the noise, of each channel as a share of its own; once a clip, and once
            more a token.
    """

    def __init__(self, encoder: Encoder, noise: float = 0.4) -> None:
        super().__init__()
        self.noise, self.prefix = noise, encoder.prefix
        self.tokens = nn.Linear(encoder.width, Descriptors.COUNT)
        self.cls = nn.Linear(encoder.projected, Descriptors.COUNT)
        for layer in (self.tokens, self.cls):
            nn.init.normal_(layer.weight, std=0.01)
            nn.init.zeros_(layer.bias)

    def forward(self, views: Views, batch: Batch) -> DescribedTouch:
        """Descriptors as every token reads them, and the true ones."""
        full = views.full
        tokens = full.tokens[:, self.prefix :]
        if self.training and self.noise:
            tokens = tokens + self.noise * _noise_like(tokens)
        return DescribedTouch(self.tokens(tokens), self.cls(full.cls), Descriptors.of(batch))


def _noise_like(tokens: Tensor) -> Tensor:
    """Uniform noise, as much in a clip as in its tokens; each with a channel's deviation."""
    batch, length, width = tokens.shape
    drawn = rand_rows(batch, 1 + length, width, device=tokens.device)
    drawn = (12**0.5 * (drawn - 0.5)).to(tokens.dtype)
    return (drawn[:, :1] + drawn[:, 1:]) * tokens.detach().std((0, 1))
