"""The head for reconstruction of masked frames."""

from __future__ import annotations

from typing import ClassVar

import torch
from torch import nn

from tactileforge.contracts import Batch, Encoder, Views
from tactileforge.encoders.relative import Relative
from tactileforge.heads.decoder import MaskedDecoder, Reconstruction, masked_patches

#: Added to the variance of a patch, as in MAE.
_LEAST = 1e-6


class PixelHead(nn.Module):
    """Predicts every frame of the masked tubes.

    Args:
        encoder: The touch encoder (given by the framework).
        width: Width of the decoder.
        depth: Number of blocks of the decoder.
        heads: Number of attention heads of the decoder.
        relative: Bias of the decoder's attention by offset, see `MaskedDecoder`.
        norm: Whether the decoder has a last norm, see `MaskedDecoder`.
        norm_pix: Whether the decoder predicts patches normalised by their own mean and deviation
            (He et al. 2022, MAE, section 4.1). The brightness of a patch, a cue for force, is then
            not learned; images are drawn with the true mean and deviation.
    """

    reads: ClassVar[frozenset[str]] = frozenset({"masked"})

    def __init__(
        self,
        encoder: Encoder,
        width: int = 512,
        depth: int = 6,
        heads: int = 8,
        relative: Relative = "none",
        norm: bool = True,
        norm_pix: bool = False,
    ) -> None:
        super().__init__()
        self.decoder = MaskedDecoder(encoder, width, depth, heads, relative=relative, norm=norm)
        self.norm_pix = norm_pix

    def forward(self, views: Views, batch: Batch) -> Reconstruction:
        """Predicts frames 1..T of the masked tubes."""
        features = views.masked
        predicted = self.decoder.frames(self.decoder(features))
        target = self.decoder.frames(masked_patches(views.patches, features))
        if not self.norm_pix:
            return Reconstruction(predicted, target, features.masked)
        variance, mean = torch.var_mean(target, dim=-1, keepdim=True)
        unit = (variance + _LEAST).sqrt()
        return Reconstruction(mean + unit * predicted, target, features.masked, unit)
