"""Regresses descriptors of a touch."""

from __future__ import annotations

from typing import ClassVar

import torch
from torch import Tensor, nn
from torch.nn import functional as F

from tactileforge.contracts import Batch
from tactileforge.data.batches.clips import Clips, collate
from tactileforge.data.labels.descriptors import GROUPS, Descriptors
from tactileforge.distributed import masked_mean
from tactileforge.heads.descriptors import DescribedTouch

#: Clips that are read to measure how descriptors vary.
_CLIPS = 512
#: Deviations beyond which a descriptor is taken as that far.
_FAR = 6.0
#: Deviations from which the loss is linear.
_LINEAR = 1.5


class DescriptorRegression(nn.Module):
    """Huber errors of image statistics, contact geometry and force, as every token reads them.

    Image statistics are of every clip, so that much needs no labels; a clip without a known surface
    or force stays out of the rest. Descriptors are taken in units of their deviation in the
    training data, which is kept in the checkpoint. Ours; regressing what a classical method reads
    follows Wei et al. 2022, Masked Feature Prediction (HOG of masked patches).

    Args:
        image: Weight of image statistics.
        contact: Weight of contact geometry.
        force: Weight of forces.
    """

    head: ClassVar[str] = "descriptors"
    needs: ClassVar[frozenset[str]] = frozenset()
    mean: Tensor
    deviation: Tensor

    def __init__(self, image: float = 1.0, contact: float = 1.0, force: float = 1.0) -> None:
        super().__init__()
        self.weights = {"image": image, "contact": contact, "force": force}
        self.register_buffer("mean", torch.zeros(Descriptors.COUNT))
        self.register_buffer("deviation", torch.ones(Descriptors.COUNT))

    def prepare(self, clips: Clips) -> None:
        """Measures mean and deviation on clips across the data; see `contracts.Prepared`."""
        step = max(1, len(clips) // _CLIPS)
        batch = collate([clips[place] for place in range(0, len(clips), step)][:_CLIPS])
        true = Descriptors.of(batch)
        values, known = true.values.double(), true.known.double()
        count = known.sum(0).clamp(min=1)
        mean = (values * known).sum(0) / count
        deviation = (((values - mean) ** 2 * known).sum(0) / count).sqrt()
        self.mean.copy_(mean)
        self.deviation.copy_(torch.where(deviation > 1e-9, deviation, 1.0))

    def forward(self, prediction: DescribedTouch, batch: Batch) -> tuple[Tensor, dict[str, Tensor]]:
        """The loss of tokens and class token together, and of each group of descriptors."""
        true, known = prediction.true, prediction.true.known
        wanted = ((true.values - self.mean) / self.deviation).clamp(-_FAR, _FAR)
        errors = _huber(prediction.tokens, wanted[:, None]).mean(1) + _huber(prediction.cls, wanted)
        logs = {
            name: masked_mean(errors[:, columns], known[:, columns])
            for name, columns in GROUPS.items()
        }
        loss = sum((self.weights[name] * part for name, part in logs.items()), errors.new_zeros(()))
        return loss, {name: part.detach() for name, part in logs.items()}

    def sums(self, prediction: DescribedTouch, batch: Batch) -> Tensor:
        """Moments of each descriptor, float64 (4, n); see `contracts.Scored`."""
        known = prediction.true.known.double()
        wanted = ((prediction.true.values - self.mean) / self.deviation).double()
        error = (prediction.tokens.detach().double().mean(1) - wanted) ** 2
        return torch.stack([(known * part).sum(0) for part in (1, wanted, wanted**2, error)])

    def scores(self, sums: Tensor) -> dict[str, float]:
        """R2 of what the mean of the tokens reads, averaged over each group."""
        count, total, square, error = sums
        variance = square - total**2 / count.clamp(min=1)
        r2 = 1 - error / variance
        means = {}
        for name, columns in GROUPS.items():
            varied = r2[columns][variance[columns] > 1e-9]
            if len(varied):
                means[f"r2_{name}"] = float(varied.mean())
        return means


def _huber(predicted: Tensor, wanted: Tensor) -> Tensor:
    predicted = predicted.float()
    return F.huber_loss(predicted, wanted.expand_as(predicted), reduction="none", delta=_LINEAR)
