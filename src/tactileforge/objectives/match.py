"""Matches clips by object, across sensors, and by action."""

from __future__ import annotations

from typing import ClassVar

import torch
from torch import Tensor, nn
from torch.nn import functional as F

from tactileforge.contracts import Batch
from tactileforge.heads.match import PairScores
from tactileforge.util.distributed import masked_mean, rand_rows
from tactileforge.util.means import Mean


class Match(nn.Module):
    """Binary cross-entropy of a positive and a negative for every clip drawn for matching.

    Positives share the anchor's ``group``, and its object with a different sensor, or its action.
    Negatives are any clips of the batch with a different known object or action. Source: AnyTouch
    2, section Semantic-Level Tactile Features, L_obj + L_act.

    Args:
        of_object: Weight of matching objects.
        of_action: Weight of matching actions.
    """

    head: ClassVar[str] = "match"
    needs: ClassVar[frozenset[str]] = frozenset({"object|action"})
    pairs: ClassVar[bool] = True

    def __init__(self, of_object: float = 1.0, of_action: float = 1.0) -> None:
        super().__init__()
        self.of_object = of_object
        self.of_action = of_action

    def forward(self, prediction: PairScores, batch: Batch) -> tuple[Mean, dict[str, Mean]]:
        """Computes the loss; logs both parts."""
        group = batch["group"]
        together = (group[:, None] == group) & (group >= 0)
        # a clip is not a pair with itself
        together.fill_diagonal_(False)
        names = {name: i for i, name in enumerate(dict.fromkeys(batch["sensor"]))}
        sensor = torch.tensor([names[name] for name in batch["sensor"]])
        sensor = sensor.to(group.device, non_blocking=True)
        other_sensor = sensor[:, None] != sensor
        of_object = pair_loss(prediction.object, batch["object"], together & other_sensor)
        of_action = pair_loss(prediction.action, batch["action"], together)
        logs = {"object": of_object.detach(), "action": of_action.detach()}
        return self.of_object * of_object + self.of_action * of_action, logs


def pair_loss(scores: Tensor, label: Tensor, together: Tensor) -> Mean:
    """``-log s(positive) - log(1 - s(negative))``, averaged over anchors with both.

    Args:
        scores: float (B, B), logits.
        label: int64 (B,), objects or actions; -1 for unknown.
        together: bool (B, B), allowed positive pairs.
    """
    known = (label[:, None] >= 0) & (label >= 0)
    same = label[:, None] == label
    positive, negative = known & same & together, known & ~same
    anchors = positive.any(1) & negative.any(1)
    # the largest of random numbers over allowed pairs is a uniform draw among them
    draw = rand_rows(len(label), 2 * len(label), device=scores.device).chunk(2, dim=1)
    chosen = [
        scores.gather(1, chance.masked_fill(~mask, -1).argmax(1, keepdim=True))[:, 0]
        for chance, mask in zip(draw, (positive, negative), strict=True)
    ]
    return masked_mean(F.softplus(-chosen[0]) + F.softplus(chosen[1]), anchors)
