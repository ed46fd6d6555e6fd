"""Each class breaks one thing, and its check sees it."""

import re
from contextlib import suppress

import pytest
import torch
from torch import nn

from tactileforge.cli.plugins import _result_lines
from tactileforge.contracts import Sensor
from tactileforge.testing import CheckResult, check
from tactileforge.util.distributed import masked_mean


class Mean(nn.Module):
    """Feeds the objectives below."""

    def __init__(self, encoder) -> None:
        super().__init__()
        self.linear = nn.Linear(encoder.width, 1)

    def forward(self, views, batch):
        return {"score": self.linear(views.full.tokens.mean(1))}


class Push(nn.Module):
    """Predicts the last normal force; the others break one thing."""

    head = "contact"
    needs = frozenset({"force"})

    def __init__(self) -> None:
        super().__init__()
        self.scale = nn.Parameter(torch.ones(()))

    def errors(self, prediction, batch):
        target = batch["force"][:, -1:, 2].nan_to_num() / 10
        return (self.scale * prediction["score"] - target).square()[:, 0]

    def forward(self, prediction, batch):
        loss = masked_mean(self.errors(prediction, batch), batch["force_valid"][:, 2])
        return self.change(loss), {"rmse": loss.detach().map(torch.sqrt)}

    def change(self, loss):
        return loss


class OddNeeds(Push):
    needs = frozenset({"force|torque"})


class NoHead(Push):
    head = None


class NotAScalar(Push):
    def change(self, loss):
        return loss.map(lambda value: value[None])


class NotFinite(Push):
    def change(self, loss):
        return loss + (loss - loss) / 0


class LogsAVector(Push):
    def forward(self, prediction, batch):
        return super().forward(prediction, batch)[0], {"rows": prediction["score"]}


class IdleParameter(Push):
    def __init__(self) -> None:
        super().__init__()
        self.idle = nn.Parameter(torch.ones(3))


class ClimbsUp(Push):
    def change(self, loss):
        return 2 * loss.detach() - loss


class CountsCalls(Push):
    calls = 0

    def change(self, loss):
        CountsCalls.calls += 1
        return loss * (1 + 0.01 * (CountsCalls.calls % 2))


class ThroughNumpy(Push):
    def errors(self, prediction, batch):
        prediction["score"].detach().numpy()
        return super().errors(prediction, batch)


class CountsTheUnlabelled(Push):
    def forward(self, prediction, batch):
        errors = self.errors(prediction, batch)
        return (errors * batch["force_valid"][:, 2]).mean(), {}


class UsesGarbage(Push):
    def forward(self, prediction, batch):
        return self.errors(prediction, batch).mean(), {}


class DoesNotCount(Push):
    def forward(self, prediction, batch):
        return super().forward(prediction, batch)[0].value, {}


class TakesItForATensor(Push):
    def change(self, loss):
        return loss.sqrt()


class Powers(Push):
    def change(self, loss):
        return loss**2


class MeanOfNothing(Push):
    def forward(self, prediction, batch):
        return self.errors(prediction, batch)[batch["force_valid"][:, 2]].mean(), {}


class NothingOverNothing(Push):
    """Finite in the first step only: then no sample is left with a small error."""

    def change(self, loss):
        few = (self.scale == 1).float()
        return loss * (few / few)


class SlopeOfARoot(Push):
    def change(self, loss):
        return loss + (loss - loss).map(lambda value: (value * self.scale).sqrt())


class Shrugs(Push):
    def forward(self, prediction, batch):
        if "force" not in batch:
            return prediction["score"].sum() * 0, {}
        return super().forward(prediction, batch)


class Mumbles(Push):
    def forward(self, prediction, batch):
        with suppress(KeyError):
            return super().forward(prediction, batch)
        raise ValueError("something is missing")


UNLABELLED = "unlabelled samples change nothing"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("plugin", "name", "detail"),
    [
        (OddNeeds, "head and needs are declared", "['torque']"),
        (NoHead, "head and needs are declared", "'head'"),
        (NotAScalar, "loss is a finite scalar", "(1,)"),
        (NotFinite, "loss is a finite scalar", "loss is nan: NaN comes from 0/0"),
        (LogsAVector, "loss is a finite scalar", "rows has shape (8, 1)"),
        (IdleParameter, "every own parameter gets gradient", "IdleParameter.idle"),
        (ClimbsUp, "twenty steps lower the loss", "it was"),
        (CountsCalls, "same seed same loss", "then"),
        (ThroughNumpy, "bf16 autocast works", "BFloat16"),
        (CountsTheUnlabelled, UNLABELLED, "with 3 samples that have 'force'"),
        (UsesGarbage, UNLABELLED, "with 3 samples that have 'force'"),
        (
            MeanOfNothing,
            UNLABELLED,
            "with no 'force' at all it is nan: NaN comes from mean of an empty set, which is 0/0, "
            "at test_check_objectives.py:",
        ),
        (
            NothingOverNothing,
            "twenty steps lower the loss",
            "is nan at a learning rate of 0.0001 in step 1: NaN comes from 0/0 (of an empty set? "
            "divide by count.clamp(min=1)) at test_check_objectives.py:",
        ),
        (
            SlopeOfARoot,
            "twenty steps lower the loss",
            "in step 0: NaN comes from the gradient at test_check_objectives.py:",
        ),
        (DoesNotCount, "labels are counted", "3 samples without 'force' count as 3"),
        (TakesItForATensor, "loss is a finite scalar", "no 'sqrt': write mean.map(FUNCTION)"),
        (Powers, "loss is a finite scalar", "returns a Mean: write mean.map(FUNCTION)"),
        (Shrugs, "missing key is named", "gives a loss without"),
        (Mumbles, "missing key is named", "ValueError: something is missing"),
    ],
)
def test_broken_objective(result_of, plugin, name, detail):
    result = result_of("objective", plugin, name, head=Mean)
    assert result.status == "failed"
    assert detail in result.detail


@pytest.mark.slow
def test_good_objective_passes(failed):
    assert not failed("objective", Push, head=Mean)


def test_an_objective_whose_head_is_not_installed(result_of):
    result = result_of("objective", Push, "head and needs are declared")
    assert "unknown head 'contact'" in result.detail


class BrokenHead(Mean):
    def forward(self, views, batch):
        raise KeyError("no such view")


class HeadWithoutEncoder(Mean):
    def __init__(self, encoder, size: int) -> None:
        super().__init__(encoder)


class NoForward(nn.Module):
    def __init__(self, encoder) -> None:
        super().__init__()


@pytest.mark.parametrize(
    ("head", "said"),
    [
        (BrokenHead, r"^its head BrokenHead is at fault: test_\w+\.py:\d+: KeyError: 'no such v"),
        (HeadWithoutEncoder, "^its head HeadWithoutEncoder is at fault: .*TypeError: .*'size'"),
        (NoForward, "^its head NoForward is at fault: it has no forward: see Head"),
    ],
)
def test_a_head_at_fault_is_named(result_of, head, said):
    result = result_of("objective", Push, "loss is a finite scalar", head=head)
    assert result.status == "failed"
    assert re.search(said, result.detail)


def test_what_a_kind_needs_is_said_once():
    class Half(Sensor):
        def discover(self):
            return []

    failed = [one for one in check("sensor", Half) if one.status == "failed"]
    assert [(one.name, one.detail) for one in failed] == [
        (
            "it has what its kind needs",
            "it has no open, no read, no close: see Sensor of tactileforge.contracts",
        )
    ]


def test_a_cause_of_several_failures_is_one_line():
    results = [
        CheckResult("a", "ran"),
        CheckResult("b", "failed", "no luck\nmore"),
        CheckResult("c", "skipped", "no luck\nmore"),
        CheckResult("d", "failed", "no luck\nmore"),
        CheckResult("e", "failed", "another"),
        CheckResult("f", "failed", "no luck\nmore"),
    ]
    assert [*_result_lines(results)] == [
        "  ran      a",
        "  failed   b and 2 more checks: no luck",
        "  skipped  c: no luck",
        "  failed   e: another",
    ]
