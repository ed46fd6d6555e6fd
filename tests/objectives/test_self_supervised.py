"""The objectives of the baselines: their formulas, and learning without collapse."""

import math
from types import SimpleNamespace
from typing import Any

import pytest
import torch
from torch.nn import functional as F

from tactileforge.contracts import Batch
from tactileforge.encoders.tactile_vit import TactileViT
from tactileforge.heads.classify import ClassifyHead
from tactileforge.heads.dino import DinoHead, Distilled
from tactileforge.heads.force import Forces
from tactileforge.heads.jepa import JepaHead, Latents
from tactileforge.heads.match import PairScores
from tactileforge.objectives.classify import Classify
from tactileforge.objectives.dino import Dino
from tactileforge.objectives.force import Force
from tactileforge.objectives.jepa import Jepa
from tactileforge.objectives.match import Match
from tactileforge.testing import batch as touches


def test_jepa_is_the_mean_absolute_error() -> None:
    predicted, target = torch.randn(2, 3, 4, 5), torch.randn(2, 3, 4, 5)
    total = 0.0
    for index in torch.cartesian_prod(*map(torch.arange, (2, 3, 4, 5))).tolist():
        total += abs(predicted[tuple(index)].item() - target[tuple(index)].item())
    loss, logs = Jepa()(Latents(predicted, target), {})
    assert loss.item() == pytest.approx(total / 120)
    collapsed = torch.randn(5).expand(2, 3, 4, 5)
    assert Jepa()(Latents(predicted, collapsed), {})[1]["spread"].item() == pytest.approx(0)
    assert logs["spread"].item() > 0.1


def test_dino_is_cross_entropy_less_the_entropy_of_the_teacher() -> None:
    student, teacher = torch.randn(3, 4), torch.randn(3, 4)
    objective = Dino(temperature=0.5, teacher_temperature=(0.25, 0.25))
    total, entropy, mean = 0.0, 0.0, [0.0] * 4
    for b in range(3):
        p = [math.exp(x / 0.25) for x in teacher[b].tolist()]
        q = [math.exp(x / 0.5) for x in student[b].tolist()]
        for k in range(4):
            share = p[k] / sum(p)
            total += share * (math.log(share) - math.log(q[k] / sum(q))) / 3
            entropy -= share * math.log(share) / 3
            mean[k] += share / 3
    loss, logs = objective(Distilled(student, teacher), {})
    assert loss.item() == pytest.approx(total, rel=1e-4)
    information = -sum(x * math.log(x) for x in mean) - entropy
    assert logs["information"].item() == pytest.approx(information, rel=1e-3)


def test_classify_is_cross_entropy_over_the_labelled(batch: Batch) -> None:
    number = 2**62 + 5  # a hash of its name
    made = batch | {"object": torch.tensor([number, 1, 2, 3, 4, 5, -1, -1])}
    logits = torch.randn(8, 7)
    classes = [number % 7, 1, 2, 3, 4, 5]
    expected = -sum(F.log_softmax(logits[i], -1)[c].item() for i, c in enumerate(classes)) / 6
    loss, logs = Classify()(logits, made)
    assert loss.item() == pytest.approx(expected, rel=1e-5)
    right = sum(int(logits[i].argmax()) == c for i, c in enumerate(classes))
    assert logs["accuracy"].item() == pytest.approx(right / 6)


def test_a_classifier_remembers_which_classes_training_has_met() -> None:
    views: Any = SimpleNamespace(full=SimpleNamespace(cls=torch.zeros(3, 4)))
    encoder: Any = SimpleNamespace(projected=4)
    head = ClassifyHead(encoder, 16)
    head(views, {"object": torch.tensor([2**62 + 5, 3, -1])})
    head.eval()
    head(views, {"object": torch.tensor([7, 8, 9])})
    assert head.met.nonzero().flatten().tolist() == sorted({(2**62 + 5) % 16, 3})


def test_a_part_of_matching_can_be_left_out(batch: Batch) -> None:
    scores = PairScores(torch.randn(8, 8), torch.randn(8, 8))
    losses = {}
    for of in ((1.0, 1.0), (1.0, 0.0), (0.0, 2.0)):
        torch.manual_seed(3)
        loss, logs = Match(*of)(scores, batch)
        losses[of] = loss.item()
        expected = of[0] * logs["object"].item() + of[1] * logs["action"].item()
        assert loss.item() == pytest.approx(expected)
    assert losses[1.0, 1.0] == pytest.approx(losses[1.0, 0.0] + losses[0.0, 2.0] / 2)


def test_force_without_shear_is_that_of_the_normal_force(batch: Batch) -> None:
    prediction = Forces(
        torch.randn(8, 3, 3, requires_grad=True), torch.randn(8, 3, 3, requires_grad=True)
    )
    loss, logs = Force(shear=False)(prediction, batch)
    loss.backward()
    scaled = (batch["force"] / batch["force_scale"][:, None])[::2, :, 2]
    expected = (prediction.force[::2, :, 2] - scaled[:, 1:]).abs().mean()
    expected += (prediction.delta[::2, :, 2] - scaled.diff(dim=1)).abs().mean()
    assert loss.item() == pytest.approx(expected.item(), rel=1e-5)
    for values in (prediction.force, prediction.delta):
        assert (values.grad[..., :2] == 0).all()
        assert (values.grad[::2, :, 2] != 0).all()
    assert list(logs) == ["mae_z_N"]


LEARNERS = {
    "jepa": (Jepa, lambda e: JepaHead(e, 64, 2, 2, momentum=0.99), 0.5),
    "dino": (Dino, lambda e: DinoHead(e, 32, 64, 16, momentum=0.99), 0.3),
    "classify": (Classify, lambda e: ClassifyHead(e, 16), 0.5),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", LEARNERS)
def test_one_batch_is_overfitted_without_collapse(name: str) -> None:
    """The loss falls, though its targets move; clips stay as far apart as they were at first."""
    batch = touches(size=8)
    encoder = TactileViT("tiny", depth=2, frames=4, image_size=32)
    objective, head, share = LEARNERS[name][0](), LEARNERS[name][1](encoder), LEARNERS[name][2]
    parameters = [p for p in [*encoder.parameters(), *head.parameters()] if p.requires_grad]
    optimizer = torch.optim.AdamW(parameters, lr=3e-4)
    losses, spread = [], []
    for step in range(60):
        torch.manual_seed(5)
        views = encoder.views(batch)
        loss, _ = objective(head(views, batch), batch)
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        losses.append(loss.item())
        with torch.no_grad():
            tokens = F.layer_norm(encoder.views(batch).full.tokens, [encoder.width])
            spread.append(tokens.mean(1).std(0, correction=0).mean().item())
        for part in (head, objective):
            if hasattr(part, "after_step"):
                part.after_step(encoder, step + 1, 60)
    print(name, losses[::11], spread[::11])
    assert losses[-1] <= share * losses[0]
    assert spread[-1] >= 0.5 * spread[0]
