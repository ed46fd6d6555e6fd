"""Reconstructs masked frame differences."""

from __future__ import annotations

from typing import ClassVar

from torch import Tensor, nn

from tactileforge.contracts import Batch
from tactileforge.heads.decoder import Reconstruction


class Diff(nn.Module):
    """Squared error on masked tubes of D_n = T_n - T_1, n = 2..N, summed over n and divided by N.

    Source: AnyTouch 2, section Pixel-Level Dynamic Details, L_rec of the differences. The divisor
    N for N - 1 differences is the paper's.
    """

    head: ClassVar[str] = "diff"
    needs: ClassVar[frozenset[str]] = frozenset()

    def forward(self, prediction: Reconstruction, batch: Batch) -> tuple[Tensor, dict[str, Tensor]]:
        """Computes the loss, averaged over masked tubes and pixels."""
        count = prediction.target.shape[2]
        return prediction.loss * (count / (count + 1)), {}
