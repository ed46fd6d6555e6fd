"""Matches clips by object, across sensors, and by action."""

from __future__ import annotations

from typing import ClassVar

import torch
from torch import Tensor, nn
from torch.nn import functional as F

from tactileforge.contracts import Batch
from tactileforge.heads.match import PairScores
from tactileforge.util.distributed import masked_means, rand_rows
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
        of_object, of_action = pair_losses(
            torch.stack([prediction.object, prediction.action]),
            torch.stack([batch["object"], batch["action"]]),
            torch.stack([together & other_sensor, together]),
        )
        logs = {"object": of_object.detach(), "action": of_action.detach()}
        return self.of_object * of_object + self.of_action * of_action, logs


def pair_losses(scores: Tensor, label: Tensor, together: Tensor) -> list[Mean]:
    """``-log s(positive) - log(1 - s(negative))``, averaged over anchors with both, n times.

    Args:
        scores: float (n, B, B), logits.
        label: int64 (n, B), objects or actions; -1 for unknown.
        together: bool (n, B, B), allowed positive pairs.
    """
    count, rows = label.shape
    known = label >= 0
    known = known[:, :, None] & known[:, None]
    same = known & (label[:, :, None] == label[:, None])
    # positive pairs, negative pairs: (n, B, 2, B)
    allowed = torch.stack([same & together, known ^ same], dim=2)
    # the largest of random numbers over allowed pairs is a uniform draw among them
    draws = [rand_rows(rows, 2 * rows, device=scores.device) for _ in range(count)]
    chosen = (torch.stack(draws).view_as(allowed) + allowed).argmax(-1, keepdim=True)
    picked = torch.stack([-scores, scores], dim=2).gather(-1, chosen)[..., 0]
    return masked_means(F.softplus(picked).sum(2), allowed.any(3).all(2))
