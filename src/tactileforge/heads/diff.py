"""The head for reconstruction of masked frame differences."""

from __future__ import annotations

from typing import ClassVar

from torch import nn

from tactileforge.contracts import Batch, Encoder, Views
from tactileforge.encoders.relative import Relative
from tactileforge.heads.decoder import MaskedDecoder, Reconstruction, check_moving, masked_patches


class DiffHead(nn.Module):
    """Predicts the differences of frames 2..T of the masked tubes from frame 1.

    Args:
        encoder: The touch encoder (given by the framework).
        width: Width of the decoder.
        depth: Number of blocks of the decoder.
        heads: Number of attention heads of the decoder.
        relative: Bias of the decoder's attention by offset, see `MaskedDecoder`.
        norm: Whether the decoder has a last norm, see `MaskedDecoder`.
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
    ) -> None:
        super().__init__()
        check_moving(encoder, "diff")
        self.decoder = MaskedDecoder(encoder, width, depth, heads, relative=relative, norm=norm)

    def forward(self, views: Views, batch: Batch) -> Reconstruction:
        """Predicts differences D_n = T_n - T_1, n = 2..T, of the masked tubes."""
        features = views.masked
        predicted = self.decoder.frames(self.decoder(features))[:, :, 1:]
        frames = self.decoder.frames(masked_patches(views.patches, features))
        return Reconstruction(predicted, frames[:, :, 1:] - frames[:, :, :1], features.masked)
