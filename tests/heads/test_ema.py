"""The slow copy of a network."""

import copy

import pytest
import torch
from torch import nn

from tactileforge.contracts import AfterStep, Batch
from tactileforge.encoders.tactile_vit import TactileViT
from tactileforge.heads.dino import DinoHead
from tactileforge.heads.ema import EMA
from tactileforge.heads.jepa import JepaHead
from tactileforge.objectives.dino import Dino


def test_the_slow_copy_is_the_closed_form_of_what_it_followed() -> None:
    """w_n = sum_i (1 - k_i) prod_{j > i} k_j w_i, and w_0 without earlier weights."""
    network = nn.BatchNorm1d(4)
    slow = EMA(network, momentum=0.9)
    total, weights = 8, [torch.randn(4, dtype=torch.float64) for _ in range(7)]
    keep = [0.0] + [1 - 0.1 * (1 - step / total) for step in range(1, 7)]
    for step, weight in enumerate(weights):
        network.weight.data = weight.float()
        network.running_mean.fill_(step)
        slow.after_step(network, step, total)
    expected = torch.zeros(4, dtype=torch.float64)
    for i, weight in enumerate(weights):
        share = 1 - keep[i]
        for later in keep[i + 1 :]:
            share *= later
        expected += share * weight
    torch.testing.assert_close(slow.network.weight.detach().double(), expected, atol=1e-6, rtol=0)
    assert (slow.network.running_mean == 6).all()  # statistics are taken as they are


def test_the_last_step_moves_nothing() -> None:
    network = nn.Linear(2, 2)
    slow = EMA(network, momentum=0.5)
    before = slow.network.weight.clone()
    network.weight.data += 1
    slow.after_step(network, 10, 10)
    assert torch.equal(slow.network.weight, before)


def test_the_slow_copy_stays_in_evaluation_mode() -> None:
    parent = nn.ModuleList([EMA(nn.Dropout(), 0.9)])
    parent.train()
    assert not parent[0].network.training


@pytest.mark.parametrize("build", [JepaHead, DinoHead])
def test_no_gradient_reaches_the_targets(build: type, encoder: TactileViT, batch: Batch) -> None:
    head = build(encoder)
    prediction = head(encoder.views(batch), batch)
    target = getattr(prediction, "target", None)
    target = prediction.teacher if target is None else target
    assert not target.requires_grad
    frozen = {name for name, p in head.named_parameters() if not p.requires_grad}
    of_encoder = {f"target.network.{name}" for name, _ in encoder.named_parameters()}
    assert of_encoder <= frozen
    assert all(".network." in name for name in frozen)


@pytest.mark.parametrize("build", [JepaHead, DinoHead])
def test_heads_follow_the_encoder(build: type, encoder: TactileViT) -> None:
    head = build(encoder, momentum=0.75)
    assert isinstance(head, AfterStep)
    moved = copy.deepcopy(encoder)
    moved.class_token.data += 1
    head.after_step(moved, 0, 2)
    torch.testing.assert_close(head.target.network.class_token, moved.class_token)
    moved.class_token.data += 1
    head.after_step(moved, 1, 2)  # 1 - 0.25 / 2 is kept
    torch.testing.assert_close(head.target.network.class_token, moved.class_token - 0.875)


def test_the_targets_are_those_of_the_whole_clip(encoder: TactileViT, batch: Batch) -> None:
    head = JepaHead(encoder, 64, 1, 2)
    views = encoder.views(batch)
    prediction = head(views, batch).target
    assert prediction.shape == (8, 2, 3, 192)
    for b in range(8):
        for slot in range(2):
            for m, position in enumerate(views.masked.masked[b].tolist()):
                token = views.full.tokens[b, views.full.prefix + 4 * slot + position]
                norm = (token - token.mean()) / token.std(correction=0)
                torch.testing.assert_close(prediction[b, slot, m], norm, atol=1e-3, rtol=0)


def test_the_centre_follows_the_teacher(encoder: TactileViT, batch: Batch) -> None:
    head = DinoHead(encoder, prototypes=16, hidden=32, bottleneck=8, centring=0.75).train()
    first = head(encoder.views(batch), batch).teacher
    head.after_step(encoder, 0, 9)
    torch.testing.assert_close(head.centre, 0.25 * first.mean(0))
    second = head(encoder.views(batch), batch).teacher
    torch.testing.assert_close(second, first - head.centre)
    assert "centre" in head.state_dict()


def test_the_temperature_of_the_teacher_rises(encoder: TactileViT) -> None:
    objective = Dino(teacher_temperature=(0.04, 0.07), warmup=0.5)
    found = []
    for step in (0, 5, 10, 20):
        objective.after_step(encoder, step, 20)
        found.append(objective.teacher_temperature.item())
    assert found == pytest.approx([0.04, 0.055, 0.07, 0.07])
