"""Predicts features of masked tubes (JEPA)."""

from __future__ import annotations

from typing import ClassVar

from torch import Tensor, nn

from tactileforge.contracts import Batch
from tactileforge.heads.jepa import Latents


class Jepa(nn.Module):
    """Mean absolute error between predicted and true features of masked tubes.

    ``mean |predicted - norm(target)|``, with the target from an EMA of the encoder on the whole
    clip, and ``norm`` a layer norm without weights. It logs the standard deviation over the batch
    of the clips' mean targets, averaged over channels: near 0 the encoder has collapsed.
    Source: V-JEPA (Bardes et al. 2024, equation 1); Sparsh, section Method.
    """

    head: ClassVar[str] = "jepa"
    needs: ClassVar[frozenset[str]] = frozenset()

    def forward(self, prediction: Latents, batch: Batch) -> tuple[Tensor, dict[str, Tensor]]:
        """Computes the loss, averaged over slots, masked tubes and channels."""
        # near 0 all clips have the same features: the encoder has collapsed
        spread = prediction.target.float().mean((1, 2)).std(0, correction=0).mean()
        return (prediction.predicted - prediction.target).abs().mean(), {"spread": spread}
