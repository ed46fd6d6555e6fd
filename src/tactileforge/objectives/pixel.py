"""Reconstructs masked frames (masked autoencoder)."""

from __future__ import annotations

from typing import ClassVar

from torch import Tensor, nn

from tactileforge.contracts import Batch
from tactileforge.heads.decoder import Reconstruction


class Pixel(nn.Module):
    """Mean squared error on masked tubes of the normalised frames.

    Source: AnyTouch 2, section Pixel-Level Dynamic Details, L_rec of the original frames.
    """

    head: ClassVar[str] = "pixel"
    needs: ClassVar[frozenset[str]] = frozenset()

    def forward(self, prediction: Reconstruction, batch: Batch) -> tuple[Tensor, dict[str, Tensor]]:
        """Computes the loss, averaged over frames, masked tubes and pixels."""
        return prediction.loss, {}
