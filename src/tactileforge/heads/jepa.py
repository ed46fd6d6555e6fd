"""The head for prediction of features of masked tubes (JEPA)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import torch
from torch import Tensor, nn
from torch.nn import functional as F

from tactileforge.contracts import Batch, Encoder, Views
from tactileforge.encoders.relative import Relative
from tactileforge.heads.decoder import MaskedDecoder, masked_patches
from tactileforge.heads.ema import EMA


@dataclass(frozen=True)
class Latents:
    """Features of masked tubes: predicted, and from the encoder's EMA.

    Attributes:
        predicted: float (B, slots, M, width), predicted features.
        target: True features, of the same shape; each token has mean 0 and variance 1, without
            gradient.
    """

    predicted: Tensor
    target: Tensor


class JepaHead(nn.Module):
    """A predictor on the visible tokens, and an EMA of the encoder on all patches.

    Source: V-JEPA (Bardes et al. 2024, section 3). The EMA never uses the universal sensor tokens.

    Args:
        encoder: The touch encoder (given by the framework).
        width: Width of the predictor.
        depth: Number of blocks of the predictor.
        heads: Number of attention heads of the predictor.
        momentum: Momentum of the EMA at the start; it rises linearly to 1.
        relative: Bias of the predictor's attention by offset, see `MaskedDecoder`.
    """

    reads: ClassVar[frozenset[str]] = frozenset({"masked"})

    def __init__(
        self,
        encoder: Encoder,
        # width and momentum as in V-JEPA, whose predictor has 12 blocks
        width: int = 384,
        depth: int = 6,
        heads: int = 6,
        momentum: float = 0.998,
        relative: Relative = "none",
    ) -> None:
        super().__init__()
        self.predictor = MaskedDecoder(encoder, width, depth, heads, encoder.width, relative)
        self.target = EMA(encoder, momentum)

    def after_step(self, encoder: Encoder, step: int, total: int) -> None:
        """Updates the EMA; see `contracts.AfterStep`."""
        self.target.after_step(encoder, step, total)

    def forward(self, views: Views, batch: Batch) -> Latents:
        """Predicts features of the masked tubes, and computes the true ones."""
        features = views.masked
        predicted = self.predictor(features)
        with torch.no_grad():
            full = self.target.network.views(batch).full
            tokens = full.tokens[:, full.prefix :].unflatten(1, (full.grid[0], -1))
            # normed without weights, as the published program of V-JEPA does
            target = F.layer_norm(masked_patches(tokens, features), tokens.shape[-1:])
        return Latents(predicted, target)
