"""The probe ``knn``: a vote of the nearest training clips, without training."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import torch
from torch import Tensor
from torch.nn import functional as F

from tactileforge_bench.fit.probes.base import Probe, Values
from tactileforge_bench.tasks.targets import TargetPart

#: Test clips that are compared at once.
_CHUNK = 512


class Knn(Probe):
    """The nearest neighbours by cosine, weighted by ``exp(cosine / temperature)``.

    Args:
        width: Size of the projected class token.
        parts: Parts of the target.
        neighbours: Number of neighbours.
        temperature: Temperature of the neighbours' weights.
    """

    tap: ClassVar[str] = "projected"
    trained: ClassVar[bool] = False

    def __init__(
        self,
        width: int,
        parts: Mapping[str, TargetPart],
        # both as in DINO's evaluation (Caron et al. 2021)
        neighbours: int = 20,
        temperature: float = 0.07,
    ) -> None:
        super().__init__(width, parts)
        self.neighbours = neighbours
        self.temperature = temperature

    def vote(self, known: Tensor, truth: Values, asked: Tensor) -> Values:
        """Predictions, (n, columns) of each part.

        Args:
            known: (m, width), features of the training clips.
            truth: (m, columns), class indices or normalised vectors.
            asked: (n, width).
        """
        known, batches = F.normalize(known, dim=1), []
        for some in torch.split(asked, _CHUNK):
            near = (F.normalize(some, dim=1) @ known.T).topk(min(self.neighbours, len(known)))
            weight = (near.values / self.temperature).softmax(1)[..., None, None]
            chosen = {name: values[near.indices] for name, values in truth.items()}
            batches.append({name: self._count(name, chosen[name], weight) for name in self.parts})
        return {name: torch.cat([batch[name] for batch in batches]) for name in self.parts}

    def _count(self, name: str, values: Tensor, weight: Tensor) -> Tensor:
        part = self.parts[name]
        if part.kind != "classes":
            return (values[..., None] * weight).sum(1)[..., 0]
        votes = F.one_hot(values.long(), len(part.names)) * weight
        return votes.sum(1).argmax(-1).float()
