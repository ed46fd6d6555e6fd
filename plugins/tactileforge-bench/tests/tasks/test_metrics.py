"""Closed forms, and values without a number."""

import math

import pytest
import torch
from tactileforge_bench.tasks import metrics
from tactileforge_bench.tasks.targets import TargetPart

from tactileforge.errors import ConfigError, DataError

ERROR = torch.tensor([[1.0, 0.0, 2.0], [-1.0, 2.0, 0.0]])
TRUTH = torch.tensor([[0.5, 1.0, 2.0], [1.5, -1.0, 4.0]])


def force(truth: torch.Tensor = TRUTH) -> TargetPart:
    return TargetPart("force", truth, torch.ones_like(truth), ("x", "y", "z"))


def classes(truth: list[int], count: int) -> TargetPart:
    column = torch.tensor(truth, dtype=torch.float32)[:, None]
    return TargetPart("classes", column, torch.ones_like(column), tuple(map(str, range(count))))


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("rmse_sum_axes", 1000 * (1 + math.sqrt(2) + math.sqrt(2))),
        ("mae_mean_axes", 1000 * (1 + 2 + 2 + 1) / 6),
        ("rmse_x", 1000.0),
        ("rmse_y", 1000 * math.sqrt(2)),
        ("rmse_z", 1000 * math.sqrt(2)),
    ],
)
def test_errors_of_force(name: str, value: float) -> None:
    measured = metrics.measure(name, force(), TRUTH + ERROR, TRUTH)
    assert measured == pytest.approx(value, rel=1e-6)


def test_correlation_is_pearsons_and_means_the_axes() -> None:
    generator = torch.Generator().manual_seed(0)
    truth = torch.randn(50, 3, generator=generator)
    predicted = truth * torch.tensor([2.0, -1.0, 0.5]) + 7
    assert metrics.measure("correlation", force(), predicted, truth) == pytest.approx(1 / 3)
    noisy = predicted + torch.randn(50, 3, generator=generator)
    stacked = [torch.corrcoef(torch.stack([noisy[:, i], truth[:, i]]))[0, 1] for i in range(3)]
    value = metrics.measure("correlation", force(), noisy, truth)
    assert value == pytest.approx(float(torch.stack(stacked).mean()), abs=1e-5)


@pytest.mark.parametrize("scale", [1e-3, 1.0, 50.0])
def test_metrics_of_force_are_the_formulas_in_float64(scale: float) -> None:
    generator = torch.Generator().manual_seed(1)
    truth = torch.randn(400, 3, generator=generator) * scale + torch.tensor([0.0, 1.0, 9.0])
    predicted = truth + 0.3 * scale * torch.randn(400, 3, generator=generator)
    x, y = predicted.double(), truth.double()
    rmse = (x - y).square().mean(0).sqrt() * 1000
    r2 = 1 - (x - y).square().sum(0) / (y - y.mean(0)).square().sum(0)
    dx, dy = x - x.mean(0), y - y.mean(0)
    pearson = (dx * dy).sum(0) / (dx.square().sum(0) * dy.square().sum(0)).sqrt()
    expected = {
        "rmse_sum_axes": rmse.sum(),
        "mae_mean_axes": (x - y).abs().mean() * 1000,
        "rmse_x": rmse[0],
        "rmse_y": rmse[1],
        "rmse_z": rmse[2],
        "r2": r2.mean(),
        "r2_bounded": r2.mean().clamp(min=0),
        "r2_z": r2[2],
        "correlation": pearson.mean(),
    }
    for name, value in expected.items():
        measured = metrics.measure(name, force(truth), predicted, truth)
        assert measured == pytest.approx(float(value), rel=1e-6), name


def test_batches_do_not_matter() -> None:
    predicted, truth = torch.randn(2, 9, 3)
    for name in ("rmse_sum_axes", "mae_mean_axes", "correlation", "r2"):
        whole = metrics.metric_kind(name).build(force())
        whole.update(predicted, truth)
        parts = metrics.metric_kind(name).build(force())
        parts.update(predicted[:4], truth[:4])
        parts.update(predicted[4:], truth[4:])
        assert float(parts.compute()) == pytest.approx(float(whole.compute()))


def test_errors_of_numbers_are_in_their_unit() -> None:
    """Mean over the columns, of the mean absolute error and of the root of the mean square."""
    truth = torch.tensor([[100.0, 1.0], [200.0, 3.0], [300.0, 5.0], [400.0, 7.0]])
    part = TargetPart("numbers", truth, torch.ones_like(truth), ("mm", "shore"))
    predicted = truth + torch.tensor([[3.0, 0.0], [-3.0, 0.0], [3.0, 2.0], [-3.0, 0.0]])
    assert metrics.measure("mae", part, predicted, truth) == pytest.approx((3 + 0.5) / 2)
    assert metrics.measure("rmse", part, predicted, truth) == pytest.approx((3 + 1) / 2)
    one = TargetPart("numbers", truth[:, :1], torch.ones(4, 1), ("mm",))
    assert metrics.measure("rmse", one, predicted[:, :1], truth[:, :1]) == pytest.approx(3)
    assert metrics.metric_kind("mae").better == metrics.metric_kind("rmse").better == "lower"


def test_distance_is_percent_of_the_width() -> None:
    truth = torch.tensor([[0.5, 0.5], [0.2, 0.1]])
    part = TargetPart("place", truth, torch.ones_like(truth), ("x", "y"))
    predicted = truth + torch.tensor([[0.03, 0.04], [0.0, 0.0]])
    assert metrics.measure("distance", part, predicted, truth) == pytest.approx(2.5, rel=1e-5)


def test_accuracy_and_f1() -> None:
    part = classes([0, 1, 1, 0, 1], 2)
    predicted = torch.tensor([[0.0], [1.0], [0.0], [1.0], [1.0]])
    assert metrics.measure("accuracy", part, predicted, part.truth) == pytest.approx(60)
    # of the second class: precision 2/3, recall 2/3
    assert metrics.measure("f1", part, predicted, part.truth) == pytest.approx(200 / 3, rel=1e-5)
    three = classes([0, 1, 2], 3)
    right = torch.tensor([[0.0], [1.0], [1.0]])
    # f1 of the classes: 1, 2/3, 0
    assert metrics.measure("f1", three, right, three.truth) == pytest.approx(500 / 9, rel=1e-5)


def test_balanced_accuracy_is_the_mean_recall_of_classes_in_the_truth() -> None:
    part = classes([0, 0, 1, 1], 3)
    predicted = torch.tensor([[0.0], [2.0], [1.0], [1.0]])
    assert metrics.measure("balanced_accuracy", part, predicted, part.truth) == 75
    uneven = classes([0, 1, 1, 1], 2)
    value = metrics.measure("balanced_accuracy", uneven, torch.ones(4, 1), uneven.truth)
    assert value == 50


def test_columns_of_classes_are_samples() -> None:
    truth = torch.tensor([[0.0, 1.0, 2.0], [1.0, 1.0, 0.0]])
    part = TargetPart("classes", truth, torch.ones_like(truth), ("a", "b", "c"))
    predicted = torch.tensor([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0]])
    assert metrics.measure("accuracy", part, predicted, truth) == pytest.approx(400 / 6)


def test_a_value_that_is_no_number_is_an_error() -> None:
    broken = torch.full((2, 3), torch.nan)
    with pytest.raises(DataError, match="rmse_sum_axes is nan on 2 samples"):
        metrics.measure("rmse_sum_axes", force(), broken, TRUTH)
    still = torch.ones(2, 3)
    with pytest.raises(DataError, match="truth never changes"):
        metrics.measure("correlation", force(), TRUTH, still)


def test_names() -> None:
    with pytest.raises(ConfigError, match="did you mean 'rmse_sum_axes'"):
        metrics.metric_kind("rmse_sum_axis")
    assert metrics.part_of("rmse_x", {"slip": classes([0], 2), "delta": force()}) == "delta"
    said = "distance measures place, and the target is force; give one of: rmse_sum_axes"
    with pytest.raises(ConfigError, match=said):
        metrics.part_of("distance", {"force": force()})
