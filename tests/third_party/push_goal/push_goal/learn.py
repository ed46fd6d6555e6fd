"""A head and an objective: how hard something presses at the end of a clip."""

from __future__ import annotations

from typing import Any, ClassVar

import torch
from torch import Tensor, nn

from tactileforge.plugin import Batch, Encoder, Views, masked_mean


class PushHead(nn.Module):
    """Normal force at the end of a clip, in units of the sensor's force scale."""

    def __init__(self, encoder: Encoder, hidden: int = 64) -> None:
        super().__init__()
        self.layers = nn.Sequential(
            nn.Linear(encoder.projected, hidden), nn.GELU(), nn.Linear(hidden, 1)
        )

    def forward(self, views: Views, batch: Batch) -> Tensor:
        """Prediction (B,)."""
        out: Tensor = self.layers(views.full.cls)[:, 0]
        return out


class Push(nn.Module):
    """Squared error of the last normal force, with a term that keeps predictions small."""

    head: ClassVar[str] = "push_goal"
    needs: ClassVar[frozenset[str]] = frozenset({"force"})

    def __init__(self, beta: float = 0.1, decay: float = 0.01) -> None:
        super().__init__()
        self.beta = beta
        self.decay = decay

    def forward(self, prediction: Tensor, batch: Batch) -> tuple[Any, dict[str, Any]]:
        """The loss, and its two parts."""
        target = batch["force"][:, -1, 2].nan_to_num() / batch["force_scale"][:, 2]
        error = nn.functional.smooth_l1_loss(prediction, target, reduction="none", beta=self.beta)
        known = batch["force_valid"][:, 2]
        loss = masked_mean(error, known)
        size = masked_mean(torch.square(prediction), known)
        return loss + self.decay * size, {"error": loss.detach(), "size": size.detach()}
