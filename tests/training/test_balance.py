"""Balances against problems with known gradients."""

import math

import pytest
import torch
from torch import Tensor, nn

from tactileforge.errors import ConfigError
from tactileforge.training import balance


class Shared(nn.Module):
    """Two weights; an objective of slope s has a gradient of norm s."""

    def __init__(self) -> None:
        super().__init__()
        self.weight = nn.Parameter(torch.tensor([3.0, 4.0]))


def losses(shared: Shared, **slopes: float) -> dict[str, Tensor]:
    """Each loss is slope * |weight|, so its gradient is slope long, and it is 5 * slope."""
    return {key: slope * shared.weight.norm() for key, slope in slopes.items()}


def test_fixed_weights_are_the_curriculums_and_gradients_are_told() -> None:
    shared, plain = Shared(), balance.build_balance({"name": "none", "every": 2}, ["a", "b", "c"])
    total = plain(losses(shared, a=2.0, b=0.5), {"a": 1.0, "b": 0.1, "c": 0.0}, 0, shared)
    assert total.item() == pytest.approx(2 * 5 + 0.1 * 0.5 * 5)
    logs = plain.logs({"a": 1.0, "b": 0.1, "c": 0.0})
    assert logs["gradient/a"].item() == pytest.approx(2)
    assert logs["gradient/b"].item() == pytest.approx(0.5)
    assert "gradient/c" not in logs  # asleep
    assert logs["weight/b"].item() == pytest.approx(0.1)
    plain(losses(shared, a=9.0), {"a": 1.0}, 1, shared)
    assert plain.norm[0].item() == pytest.approx(2)  # measured every second step


def test_gradnorm_makes_gradients_alike() -> None:
    """Fifty-fold differences, as between the objectives of AnyTouch 2 at the start."""
    shared = Shared()
    even = balance.GradNorm(["a", "b", "c"], alpha=0.0, bound=100.0)
    slopes = {"a": 0.93, "b": 0.19, "c": 0.018}
    even(losses(shared, **slopes), dict.fromkeys("abc", 1.0), 0, shared)
    reached = even.factor * torch.tensor(list(slopes.values()))
    torch.testing.assert_close(reached, reached.mean().expand(3))
    assert even.factor.log().mean().item() == pytest.approx(0, abs=1e-6)


def test_gradnorm_helps_what_has_fallen_least() -> None:
    """Chen et al., equation 2: norms go as the loss ratio to the power of alpha."""
    shared, even = Shared(), balance.GradNorm(["a", "b"], every=1, alpha=1.5, keep=0.0)
    weights = {"a": 1.0, "b": 1.0}
    even(losses(shared, a=1.0, b=1.0), weights, 0, shared)
    even(losses(shared, a=0.8, b=0.4), weights, 1, shared)
    reached = even.factor * torch.tensor([0.8, 0.4])
    ratios = torch.tensor([0.8, 0.4]) / 0.6
    assert (reached[0] / reached[1]).item() == pytest.approx(
        ((ratios[0] / ratios[1]) ** 1.5).item()
    )


def test_a_loss_that_has_nothing_left_does_not_take_over() -> None:
    shared, even = Shared(), balance.GradNorm(["a", "b"], every=1, keep=0.0, bound=8.0)
    for step, slope in enumerate([1.0, 1e-3, 1e-9]):
        even(losses(shared, a=1.0, b=slope), {"a": 1.0, "b": 1.0}, step, shared)
        assert even.factor.max().item() <= 8 + 1e-5
        assert even.factor.min().item() >= 1 / 8 - 1e-5
    assert math.isfinite(even.factor.sum().item())


def test_an_objective_that_starts_later_joins() -> None:
    shared, even = Shared(), balance.GradNorm(["a", "b"], every=5, alpha=0.0)
    for step in range(12):
        awake = {"a": 2.0} | ({"b": 0.5} if step >= 7 else {})
        even(losses(shared, **awake), {"a": 1.0, "b": float(step >= 7)}, step, shared)
        if step < 10:
            assert even.factor.tolist() == [1.0, 1.0]  # alone, or not measured yet
    torch.testing.assert_close(even.factor * torch.tensor([2.0, 0.5]), torch.ones(2))
    before = even.factor.clone()
    nothing = {"a": losses(shared, a=2.0)["a"], "b": shared.weight.sum() * 0}
    even(nothing, {"a": 1.0, "b": 1.0}, 15, shared)  # a batch without its labels
    torch.testing.assert_close(even.factor, before)


def test_uncertainty_settles_where_losses_count_alike() -> None:
    shared, kendall = Shared(), balance.Uncertainty(["a", "b", "c"], bound=20.0)
    for step in range(400):
        found = losses(shared, a=0.04, b=0.8) | {"c": shared.weight.sum() * 0}
        kendall(found, dict.fromkeys("abc", 1.0), step, shared)
    assert kendall.factor.tolist() == pytest.approx([1 / 0.2, 1 / 4.0, 1.0], rel=1e-3)


def test_batches_of_one_step_move_the_weights_once() -> None:
    shared = Shared()
    once, often = (balance.Uncertainty(["a", "b"], bound=20.0) for _ in range(2))
    for step in range(5):
        for kendall, times in ((once, 1), (often, 4)):
            for _ in range(times):
                kendall(losses(shared, a=0.04, b=0.8), {"a": 1.0, "b": 1.0}, step, shared)
    torch.testing.assert_close(often.factor, once.factor)


def test_clipping_each_objective() -> None:
    shared, clip = Shared(), balance.GradClip(["a", "b"], limit=1.0)
    clip(losses(shared, a=4.0, b=0.5), {"a": 0.5, "b": 1.0}, 0, shared)
    assert clip.factor.tolist() == pytest.approx([0.5, 1.0])


@pytest.mark.parametrize("name", ["gradnorm", "uncertainty", "clip"])
def test_a_balance_goes_on_from_its_state(name: str) -> None:
    def steps(weights_of: balance.FixedWeights, first: int, last: int) -> None:
        shared = Shared()
        for step in range(first, last):
            slopes = {"a": 2 / (1 + step), "b": 3.0}
            weights_of(losses(shared, **slopes), {"a": 1.0, "b": 1.0}, step, shared)

    whole, half, other = (balance.build_balance({"name": name}, ["a", "b"]) for _ in range(3))
    steps(whole, 0, 40)
    steps(half, 0, 17)
    other.load_state_dict(half.state_dict())
    steps(other, 17, 40)
    assert not torch.equal(whole.factor, torch.ones(2))
    for key, value in whole.state_dict().items():
        assert torch.equal(value, other.state_dict()[key]), key


@pytest.mark.parametrize(
    ("config", "message"),
    [
        ({"name": "gradnrom"}, "unknown balance 'gradnrom'"),
        ({"name": "gradnorm", "bound": 1.0}, r"balance\.bound"),
        ({"name": "none", "alpha": 1.0}, "balance=none.*alpha"),
        ({"name": "clip", "limit": 0.0}, r"balance\.limit=0"),
        ({"name": "none", "every": -1}, r"balance\.every=-1"),
    ],
)
def test_bad_options_are_named(config: dict[str, object], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        balance.build_balance(config, ["a"])
