"""Classifies clips by the touched object."""

from __future__ import annotations

from typing import ClassVar

from torch import Tensor, nn
from torch.nn import functional as F

from tactileforge.contracts import Batch
from tactileforge.util.distributed import masked_mean
from tactileforge.util.means import Mean


class Classify(nn.Module):
    """Cross-entropy of the object, over the clips with a known object.

    Data is streamed, so the number of objects is unknown: the class of an object is its number, a
    hash of its name, modulo the number of the head's classes. With many more classes than objects
    few objects share one. Objects not seen in training have no meaningful class. Source: the
    supervised stage of T3 (Zhao et al. 2024).
    """

    head: ClassVar[str] = "classify"
    needs: ClassVar[frozenset[str]] = frozenset({"object"})

    def forward(self, prediction: Tensor, batch: Batch) -> tuple[Mean, dict[str, Mean]]:
        """Computes the loss; logs the accuracy of the highest score."""
        known = batch["object"] >= 0
        # -1 of unknown objects gets a class too, and is left out by `known`
        label = batch["object"].remainder(prediction.shape[-1])
        loss = F.cross_entropy(prediction, label, reduction="none")
        right = (prediction.detach().argmax(-1) == label).float()
        return masked_mean(loss, known), {"accuracy": masked_mean(right, known)}
