"""Predicts the demonstrated commands."""

from __future__ import annotations

from typing import ClassVar, Literal

from torch import nn
from torch.nn import functional as F

from tactileforge.contracts import Batch
from tactileforge.errors import ConfigError
from tactileforge.training import Mean, masked_mean
from tactileforge_policies.heads.base import ChunkPrediction

_LOSSES = {"l1": F.l1_loss, "huber": F.smooth_l1_loss}


class Imitate(nn.Module):
    """Error of commands from -1 to 1, over those before the end of the episode.

    Args:
        loss: ``l1`` (as in ACT) or ``huber`` (linear above an error of 1).
    """

    head: ClassVar[str] = "regression"
    needs: ClassVar[frozenset[str]] = frozenset({"action_chunk"})

    def __init__(self, loss: Literal["l1", "huber"] = "l1") -> None:
        super().__init__()
        self.loss = loss

    def forward(self, prediction: ChunkPrediction, batch: Batch) -> tuple[Mean, dict[str, Mean]]:
        """Computes the loss; logs the mean absolute error in the robot's units.

        Raises:
            ConfigError: The head predicts noise.
        """
        if prediction.unit is None:
            raise ConfigError(
                "objective=imitate with a head that predicts noise: give head=[regression] or "
                "head=[act], or objective=[denoise]"
            )
        predicted, valid = prediction.predicted.float(), batch["action_chunk_valid"]
        error = _LOSSES[self.loss](predicted, prediction.target, reduction="none").mean(-1)
        far = (predicted.detach() - prediction.target).abs() * prediction.unit
        return masked_mean(error, valid), {"mae": masked_mean(far.mean(-1), valid)}
