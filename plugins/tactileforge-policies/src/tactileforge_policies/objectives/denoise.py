"""Predicts the noise in a chunk of commands."""

from __future__ import annotations

from typing import ClassVar

from torch import nn

from tactileforge.contracts import Batch
from tactileforge.training import Mean, masked_mean
from tactileforge_policies.heads.base import ChunkPrediction


class Denoise(nn.Module):
    """Squared error of the noise, over the commands before the end of the episode.

    Source: Chi et al. 2023, Diffusion Policy (epsilon).
    """

    head: ClassVar[str] = "diffusion_policy"
    needs: ClassVar[frozenset[str]] = frozenset({"action_chunk"})

    def forward(self, prediction: ChunkPrediction, batch: Batch) -> tuple[Mean, dict[str, Mean]]:
        """Computes the loss."""
        error = (prediction.predicted.float() - prediction.target) ** 2
        return masked_mean(error.mean(-1), batch["action_chunk_valid"]), {}
