"""Tokens learn the features of a frozen image model."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import pytest
import torch
from torch import Tensor, nn
from torch.nn import functional as F

from tactileforge.contracts import Batch
from tactileforge.encoders.tactile_vit import TactileViT
from tactileforge.encoders.vit import ImageViT
from tactileforge.heads.distill import DistillHead, Taught
from tactileforge.objectives.distill import Distill


class Brightness(nn.Module):
    """A teacher of brightness and its square, at two sizes."""

    def __init__(self) -> None:
        super().__init__()
        self.unused = nn.Linear(1, 1)

    def maps(self, images: Tensor) -> list[Tensor]:
        grey = (images - 127.5).mean(1, keepdim=True) / 50
        both = torch.cat([grey, 3 + grey.square()], 1)
        return [F.avg_pool2d(both, 4), F.avg_pool2d(both, 16)]


def encoder() -> TactileViT:
    return TactileViT("tiny", depth=2, frames=4, image_size=32, patch=8, norm_in=False)


def rows(batch: Batch) -> Sequence[dict[str, Any]]:
    return [
        {key: batch[key][i] for key in ("frames", "background")}
        for i in range(len(batch["frames"]))
    ]


def test_targets_have_mean_0_and_deviation_1_over_the_training_data(batch: Batch) -> None:
    touch = encoder()
    head = DistillHead(touch, Brightness())
    head.prepare(rows(batch))  # type: ignore[arg-type]
    found = head(touch.views(batch), batch)
    assert [one.shape[1:] for one in found.target] == [(2, 4, 4), (2, 2, 2), (8,)]
    assert [one.shape for one in found.predicted] == [one.shape for one in found.target]
    for target in found.target:
        numbers = target.transpose(0, 1).flatten(1)
        torch.testing.assert_close(numbers.mean(1), torch.zeros(len(numbers)), atol=1e-4, rtol=0)
        torch.testing.assert_close(
            numbers.std(1, correction=0), torch.ones(len(numbers)), atol=1e-3, rtol=0
        )


def test_the_teacher_sees_the_last_frame_less_the_background(batch: Batch) -> None:
    touch = encoder()
    head = DistillHead(touch, Brightness(), gain=2.0)
    seen: list[Tensor] = []
    maps = head.teacher.maps

    def noted(pictures: Tensor) -> Any:
        seen.append(pictures)
        return maps(pictures)

    head.teacher.maps = noted
    batch = batch | {"frames": batch["frames"].clone(), "background": batch["frames"][:, -1]}
    batch["frames"][:, :-1] = 0  # earlier frames are not seen
    head(touch.views(batch), batch)
    assert (seen[0] == 127.5).all()
    darker = batch | {"background": batch["background"].clamp(min=10) - 10}
    head(touch.views(darker), darker)
    change = batch["background"].float() - darker["background"].float()
    assert torch.equal(seen[1], 127.5 + 2.0 * change)


@pytest.mark.slow
def test_it_learns_and_the_teacher_does_not(batch: Batch) -> None:
    touch = encoder()
    head = DistillHead(touch, Brightness()).train()
    head.prepare(rows(batch))  # type: ignore[arg-type]
    objective = Distill()
    wanted = [p for p in (*touch.parameters(), *head.parameters()) if p.requires_grad]
    assert not any(p is q for p in wanted for q in head.teacher.parameters())
    optimiser = torch.optim.AdamW(wanted, lr=2e-3)
    scores = []
    for step in range(41):
        prediction = head(touch.views(batch), batch)
        loss, _ = objective(prediction, batch)
        if step in (0, 40):
            scores.append(objective.scores(objective.sums(prediction, batch)))
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
    assert scores[0]["r2_maps"] < 0.3
    assert scores[1]["r2_maps"] > 0.8
    assert scores[1]["r2_whole"] > 0.6
    assert not head.teacher.training


def test_a_teacher_without_maps_gives_its_vector(batch: Batch) -> None:
    touch = encoder()
    head = DistillHead(touch, ImageViT(depth=1, image_size=32, frozen=True))
    found = head(touch.views(batch), batch)
    assert [one.shape for one in found.predicted] == [(len(batch["frames"]), 192)]


def test_the_loss_counts_every_map_alike_and_scores_are_r2() -> None:
    true = (torch.randn(3, 2, 4, 4), torch.randn(3, 5))
    said = (true[0] + 0.5, true[1] - 1.0)
    objective = Distill()
    loss, _ = objective(Taught(said, true), {})
    assert loss.item() == pytest.approx((0.25 + 1.0) / 2, rel=1e-5)
    halves = [
        objective.sums(Taught(tuple(x[cut] for x in said), tuple(x[cut] for x in true)), {})
        for cut in (slice(0, 1), slice(1, 3))
    ]
    scores = objective.scores(halves[0] + halves[1])
    assert scores["r2_maps"] == pytest.approx(1 - 0.25 / true[0].var(correction=0).item(), rel=1e-5)
    assert scores["r2_whole"] == pytest.approx(1 - 1 / true[1].var(correction=0).item(), rel=1e-5)
