"""Classifies clips by the touched object."""

from __future__ import annotations

from typing import ClassVar

from torch import Tensor, nn
from torch.nn import functional as F

from tactileforge.contracts import Batch
from tactileforge.distributed import masked_mean
from tactileforge.means import Mean


class Classify(nn.Module):
    """Cross-entropy of the object, over the clips that have one.

    Data stream in, so nobody has counted the objects: an object's number, made from its name,
    modulo the number of the head's classes is its class. With many more classes than objects few
    share one. Of objects that training has not met it says nothing. Source: the supervised stage of
    T3 (Zhao et al. 2024).
    """

    head: ClassVar[str] = "classify"
    needs: ClassVar[frozenset[str]] = frozenset({"object"})

    def forward(self, prediction: Tensor, batch: Batch) -> tuple[Mean, dict[str, Mean]]:
        """The loss; logs the share of clips whose class scores highest."""
        known = batch["object"] >= 0
        label = batch["object"].remainder(prediction.shape[-1])
        loss = F.cross_entropy(prediction, label, reduction="none")
        right = (prediction.detach().argmax(-1) == label).float()
        return masked_mean(loss, known), {"accuracy": masked_mean(right, known)}
