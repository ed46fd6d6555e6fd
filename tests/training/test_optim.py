"""Optimisers and schedules."""

import math

import pytest
import torch
from torch import nn

from tactileforge.errors import ConfigError, PluginError
from tactileforge.plugins import registry
from tactileforge.testing import check
from tactileforge.training.optim import AdamW, build_optimizer, parse_optim, set_rate

ADAMW = {"name": "adamw", "lr": 1e-3, "weight_decay": 0.1, "betas": [0.9, 0.99]}


def test_adamw_passes_the_suite() -> None:
    assert {result.status for result in check("optimizer", "adamw")} <= {"ran", "skipped"}


def test_vectors_do_not_decay_and_frozen_weights_are_left_out() -> None:
    network = nn.Sequential(nn.Linear(3, 4), nn.LayerNorm(4))
    network[0].weight.requires_grad_(False)
    extra = nn.Parameter(torch.ones(2, 2))
    named = [*network.named_parameters(), ("extra", extra)]
    made = build_optimizer(named, {**ADAMW, "schedule": "constant"}, total=10)["optimizer"]
    assert [len(group["params"]) for group in made.param_groups] == [1, 3]
    assert [group["weight_decay"] for group in made.param_groups] == [0.1, 0.0]


def test_a_configuration_without_a_name_is_adamw() -> None:
    """As runs of before plugins of optimisers have it."""
    plugin, options = parse_optim({"lr": 1e-3, "weight_decay": 0.0, "betas": [0.9, 0.9]})
    assert isinstance(plugin, AdamW)
    assert (options.schedule, options.clip) == ("linear", 1.0)


@pytest.mark.parametrize(
    ("row", "error", "message"),
    [
        ({"name": "adam"}, PluginError, "unknown optimizer 'adamm'; did you mean 'adam'"),
        ({"momentum": 0.9}, ConfigError, "momentum"),
        (
            {"schedule": "cosin"},
            ConfigError,
            "optim.schedule 'cosin'; did you mean 'cosine'",
        ),
        ({"lr": -1.0}, ConfigError, "optim.lr=-1.0"),
        ({"betas": [0.9, 1.0]}, ConfigError, "optim.betas"),
        ({"warmup": 2.0}, ConfigError, "optim.warmup=2.0"),
        ({"clip": 0.0}, ConfigError, "optim.clip=0.0"),
    ],
)
def test_mistakes(row: dict[str, object], error: type[Exception], message: str) -> None:
    with pytest.raises(error) as raised:
        parse_optim({**ADAMW, **row})
    assert message in str(raised.value)


@pytest.mark.parametrize(
    ("name", "step", "factor"),
    [
        ("linear", 0, 0.1),
        ("linear", 9, 1.0),
        ("linear", 100, 0.0),
        ("cosine", 0, 0.0),
        ("cosine", 10, 1.0),
        ("cosine", 55, 0.5),
        ("cosine", 100, 0.0),
        ("constant", 5, 0.5),
        ("constant", 99, 1.0),
    ],
)
def test_schedules_at_known_steps(name: str, step: int, factor: float) -> None:
    assert registry.load("schedules", name)(step, 10, 100) == pytest.approx(factor, abs=1e-12)


def test_cosine_is_that_of_diffusers() -> None:
    known = pytest.importorskip("diffusers.optimization")
    weight = nn.Parameter(torch.zeros(2))
    theirs = torch.optim.SGD([weight], lr=1.0)
    schedule = known.get_scheduler("cosine", theirs, num_warmup_steps=7, num_training_steps=40)
    ours = registry.load("schedules", "cosine")
    for step in range(40):
        assert ours(step, 7, 40) == pytest.approx(schedule.get_last_lr()[0], abs=1e-12)
        theirs.step()
        schedule.step()


def test_the_rate_of_a_resumed_step_is_that_of_the_new_length() -> None:
    weight = nn.Parameter(torch.zeros(2, 2))
    made = build_optimizer([("weight", weight)], {**ADAMW, "warmup": 0.0}, total=10)
    schedule = made["lr_scheduler"]["scheduler"]
    schedule.last_epoch = 5
    set_rate(schedule)
    rate = made["optimizer"].param_groups[0]["lr"]
    assert math.isclose(rate, 1e-3 * registry.load("schedules", "linear")(5, 1, 10))
