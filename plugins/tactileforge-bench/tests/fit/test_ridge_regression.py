"""The probes ridge and logistic against brute force, and on data with a known answer."""

import numpy as np
import pytest
import torch
from tactileforge_bench.fit.probes import convex, probe_class, ridge_regression
from tactileforge_bench.fit.probes.group_weights import group_kernels, weight_grid
from tactileforge_bench.fit.probes.logistic import Logistic, balanced_error, inner_folds
from tactileforge_bench.fit.probes.ridge import Ridge, choose_weights, places_of
from tactileforge_bench.tasks.targets import TargetPart
from torch import Tensor

from tactileforge.errors import ConfigError


def made(samples: int, width: int, seed: int = 0) -> tuple[Tensor, torch.Generator]:
    rng = torch.Generator().manual_seed(seed)
    return torch.randn(samples, width, generator=rng), rng


def solved(x: Tensor, y: Tensor, penalty: float, asked: Tensor) -> Tensor:
    """Ridge by its normal equations, the intercept without penalty."""
    design = torch.cat([torch.ones(len(x), 1), x], 1).double()
    weight = penalty * torch.eye(design.shape[1], dtype=torch.float64)
    weight[0, 0] = 0
    fitted = torch.linalg.solve(design.T @ design + weight, design.T @ y.double())
    return torch.cat([torch.ones(len(asked), 1), asked], 1).double() @ fitted


@pytest.mark.parametrize("width", [5, 60])
@pytest.mark.parametrize("size", [1, 4])
def test_groups_left_out_in_closed_form_are_those_left_out_by_hand(width: int, size: int) -> None:
    x, rng = made(24, width)
    x = ridge_regression.standardise(x, x)[0].double()
    y = torch.randn(24, 2, generator=rng)
    fitted = ridge_regression.fit_ridge(x @ x.T, y)
    groups = list(torch.arange(24).split(size))
    for penalty in fitted.penalties[4::4]:
        closed = fitted.left_out([penalty], groups)[0]
        for places in groups:
            rest = torch.tensor([i for i in range(24) if i not in places.tolist()])
            brute = solved(x[rest], y[rest], penalty, x[places])
            assert torch.allclose(closed[places], brute, atol=1e-5)
        new = torch.randn(7, width, generator=rng).double()
        dual = (new @ x.T).double() @ fitted.dual(penalty) + fitted.mean
        assert torch.allclose(dual, solved(x, y, penalty, new), atol=1e-5)


def test_features_that_stand_still_do_not_count() -> None:
    x, _ = made(10, 3)
    x[:, 1] = 7.0
    known, asked = ridge_regression.standardise(x, x + 1)
    assert known[:, 1].abs().max() == asked[:, 1].abs().max() == 0
    assert known[:, [0, 2]].std(0, correction=0) == pytest.approx([1.0, 1.0], rel=1e-5)


def classes(names: int) -> TargetPart:
    return TargetPart(
        "classes", torch.zeros(0, 1), torch.zeros(0, 1), tuple(map(str, range(names)))
    )


def halves(part: TargetPart, x: Tensor, y: Tensor, kind: type[Ridge] = Ridge) -> Tensor:
    """Predictions of the second half."""
    half = len(x) // 2
    names = [str(i) for i in range(half)]
    model = kind(x.shape[1], {"a": part})
    _, out = model.solve(x[:half], {"a": y[:half]}, names, x[half:])
    return out["a"]


@pytest.mark.slow
@pytest.mark.parametrize("kind", [Ridge, Logistic])
def test_it_tells_classes_apart_that_are_apart_and_only_those(kind: type[Ridge]) -> None:
    right: dict[str, list[float]] = {"own": [], "shuffled": []}
    for seed in range(6, 12):
        noise, rng = made(240, 40, seed)
        y = torch.randint(3, (240, 1), generator=rng).float()
        x = noise + 1.5 * torch.nn.functional.one_hot(y[:, 0].long(), 40)
        right["own"].append(float((halves(classes(3), x, y, kind) == y[120:]).float().mean()))
        mixed = y[torch.randperm(240, generator=rng)]
        right["shuffled"].append(
            float((halves(classes(3), x, mixed, kind) == mixed[120:]).float().mean())
        )
    assert np.mean(right["own"]) > 0.65
    # 720 guesses: the standard error of a third is 0.018
    assert np.mean(right["shuffled"]) == pytest.approx(1 / 3, abs=0.045)


@pytest.mark.slow
@pytest.mark.parametrize("kind", [Ridge, Logistic])
def test_rare_classes_count_as_much_as_common_ones(kind: type[Ridge]) -> None:
    noise, rng = made(600, 10)
    y = (torch.rand(600, 1, generator=rng) < 0.1).float()
    x = noise + 1.0 * torch.cat([y, torch.zeros(600, 9)], 1)
    fitted, truth = halves(classes(2), x, y, kind), y[300:]
    recall = [float((fitted[truth == k] == k).float().mean()) for k in (0, 1)]
    assert abs(recall[0] - recall[1]) < 0.2
    assert min(recall) > 0.55


@pytest.mark.parametrize("kind", [Ridge, Logistic])
def test_features_that_say_nothing_give_one_class(kind: type[Ridge]) -> None:
    """As those of the baseline ``chance``."""
    y = torch.randint(3, (60, 1), generator=made(1, 1)[1]).float()
    assert halves(classes(3), torch.ones(60, 4), y, kind).unique().numel() == 1


def test_each_axis_has_a_penalty_of_its_own() -> None:
    x, rng = made(120, 200)
    plain = x[:, :1]
    y = torch.cat([plain, torch.randn(120, 1, generator=rng)], 1)
    part = TargetPart("numbers", torch.zeros(0, 2), torch.zeros(0, 2), ("signal", "noise"))
    fitted = halves(part, x, y)
    assert np.corrcoef(fitted[:, 0], y[60:, 0])[0, 1] > 0.3
    assert fitted[:, 1].std() < 0.2, "noise is predicted by its mean"


def test_inner_folds_go_by_group() -> None:
    """A feature with the name of the recording explains its own clips, and no others."""
    rng = torch.Generator().manual_seed(3)
    group = torch.arange(20).repeat_interleave(6)
    y = torch.randn(20, generator=rng)[group][:, None]
    x = torch.randn(20, 30, generator=rng)[group]
    part = TargetPart("numbers", torch.zeros(0, 1), torch.zeros(0, 1), ("level",))

    def error(names: list[str]) -> float:
        inner, _ = Ridge(30, {"a": part}).solve(x, {"a": y}, names, x)
        return float((inner["a"] - y).square().mean() / y.var())

    assert error([str(i) for i in range(120)]) < 0.01
    assert error([str(int(i)) for i in group]) > 0.7
    assert error(["one"] * 120) == error([str(i) for i in range(120)])


@pytest.mark.slow
def test_logistic_inner_folds_go_by_group() -> None:
    """A feature with the name of the recording explains the class of its own clips alone."""
    rng = torch.Generator().manual_seed(3)
    group = torch.arange(20).repeat_interleave(6)
    y = torch.randint(2, (20,), generator=rng)[group][:, None].float()
    x = torch.randn(20, 30, generator=rng)[group] + 0.01 * torch.randn(120, 30, generator=rng)

    def right(names: list[str]) -> float:
        inner, _ = Logistic(30, {"a": classes(2)}).solve(x, {"a": y}, names, x)
        return float((inner["a"] == y).float().mean())

    assert right([str(i) for i in range(120)]) == 1
    assert right([str(int(i)) for i in group]) < 0.75
    assert right(["one"] * 120) == 1, "a single group is dealt sample by sample"


def test_groups_are_dealt_whole_to_folds_of_like_size() -> None:
    groups = list(torch.arange(30).split([8, 1, 5, 3, 7, 2, 4]))
    folds = inner_folds(groups)
    assert sorted(torch.cat(folds).tolist()) == list(range(30))
    assert [len(fold) for fold in folds] == [8, 8, 7, 7]
    for places in groups:
        assert sum(bool(torch.isin(places, fold).any()) for fold in folds) == 1
    assert len(inner_folds(groups[:2])) == 2


def test_the_logistic_fit_is_where_its_gradient_vanishes() -> None:
    x, rng = made(60, 200)
    y = torch.randint(3, (60, 1), generator=rng).float()
    error, centred = balanced_error(classes(3), y), (x - x.mean(0)).double()
    layer = convex.fit_layer(
        convex.axes_of(centred), error, 0.5, torch.zeros(201, 3, dtype=torch.float64)
    )
    layer.requires_grad_()
    loss = error(centred @ layer[:-1] + layer[-1]) + 0.5 * layer[:-1].square().sum() / 2
    loss.backward()
    assert layer.grad is not None
    assert layer.grad.abs().max() < 1e-5
    assert layer[:-1].detach().norm() > 0.1


def test_coordinates_keep_every_product() -> None:
    x, rng = made(20, 50)
    new = torch.randn(7, 50, generator=rng)
    gram, cross = (x @ x.T).double(), (new @ x.T).double()
    known, asked = ridge_regression.coordinates(gram, cross)
    assert known.shape == (20, 20)
    assert torch.allclose(known @ known.T, gram, atol=1e-8)
    assert torch.allclose(asked @ known.T, cross, atol=1e-8)


def test_logistic_reads_numbers_as_ridge_does() -> None:
    x, rng = made(80, 30)
    y = x[:, :1] + torch.randn(80, 1, generator=rng)
    part = TargetPart("numbers", torch.zeros(0, 1), torch.zeros(0, 1), ("a",))
    assert torch.equal(halves(part, x, y, Logistic), halves(part, x, y))


@pytest.mark.parametrize("kind", [Ridge, Logistic])
def test_it_has_a_name(kind: type[Ridge]) -> None:
    assert probe_class(kind.__name__.lower()) is kind
    assert not kind.trained
    assert kind.readings == ("pooled", "summary", "patches", "groups")


def test_kernels_count_alike_however_wide_and_strong_they_are() -> None:
    x, rng = made(30, 45)
    x[:, 5:] *= 100
    new = torch.randn(7, 45, generator=rng)
    kernels = group_kernels(x, new, [5, 40])
    assert kernels.gram.diagonal(dim1=1, dim2=2).mean(1).tolist() == pytest.approx([1, 1])
    mean, spread = x.mean(0), x.std(0, correction=0)
    own, asked = ((each - mean) / spread for each in (x, new))
    for group, places in enumerate((slice(0, 5), slice(5, 45))):
        wanted = asked[:, places] @ own[:, places].T / own[:, places].shape[1]
        assert torch.allclose(kernels.cross[group].float(), wanted, atol=1e-5)
    with pytest.raises(ConfigError, match="45 features"):
        group_kernels(x, new, [5, 41])


@pytest.mark.parametrize(("groups", "count"), [(1, 1), (2, 5), (3, 15), (4, 35)])
def test_weights_lie_on_the_simplex(groups: int, count: int) -> None:
    grid = weight_grid(groups)
    assert len(set(grid)) == len(grid) == count
    assert all(sum(row) == 1 and min(row) >= 0 for row in grid)
    for place in range(groups):
        assert tuple(float(place == i) for i in range(groups)) in grid


def weighed(kind: type[Ridge], part: TargetPart, y: Tensor, sizes: list[int]) -> list[Tensor]:
    """Predictions of the second half: from the first group alone, and from both, weighed."""
    x, rng = made(120, 6, seed=5)
    x[:, 0] += 2 * (y[:, 0] - y[:, 0].mean())
    both = torch.cat([x, torch.randn(120, 400, generator=rng)], 1)
    names = [str(i) for i in range(60)]
    out = []
    for features, parts in ((x, []), (both, sizes)):
        model = kind(features.shape[1], {"a": part})
        solved = model.solve(features[:60], {"a": y[:60]}, names, features[60:], parts)
        out.append(solved[1]["a"])
    return out


@pytest.mark.slow
def test_a_group_of_many_features_that_say_nothing_gets_no_weight() -> None:
    """In one group with the others, 400 columns of noise hide the six useful ones."""
    y = torch.randn(120, 1, generator=torch.Generator().manual_seed(1))
    part = TargetPart("numbers", torch.zeros(0, 1), torch.zeros(0, 1), ("n",))
    alone, both = weighed(Ridge, part, y, [6, 400])
    assert torch.allclose(both, alone, atol=1e-5)
    _, mixed = weighed(Ridge, part, y, [406])
    errors = [float((found - y[60:]).square().mean()) for found in (both, mixed)]
    assert errors[0] < 0.6 * errors[1]


@pytest.mark.slow
@pytest.mark.parametrize("kind", [Ridge, Logistic])
def test_classes_are_weighed_too(kind: type[Ridge]) -> None:
    y = torch.randint(3, (120, 1), generator=torch.Generator().manual_seed(1)).float()
    alone, both = weighed(kind, classes(3), y, [6, 400])
    _, mixed = weighed(kind, classes(3), y, [406])
    right = [float((found == y[60:]).float().mean()) for found in (alone, both, mixed)]
    assert right[1] > right[0] - 0.07
    assert right[1] > right[2] + 0.1


def test_weights_go_by_the_group_of_samples() -> None:
    """Features of the recording's identity are of no use for another, and get no weight."""
    rng = torch.Generator().manual_seed(3)
    group = torch.arange(24).repeat_interleave(5)
    y = torch.randn(24, generator=rng)[group][:, None]
    names = torch.randn(24, 30, generator=rng)[group]
    hint = y + 0.5 * torch.randn(120, 1, generator=rng)
    part = TargetPart("numbers", torch.zeros(0, 1), torch.zeros(0, 1), ("level",))

    def weights(recordings: list[str]) -> tuple[float, ...]:
        kernels = group_kernels(torch.cat([hint, names], 1), torch.zeros(1, 31), [1, 30])
        return choose_weights(part, kernels, y, places_of(recordings))

    assert weights([str(int(i)) for i in group]) == (1.0, 0.0)
    assert weights([str(i) for i in range(120)])[1] > 0


def test_of_weights_that_predict_as_well_the_most_of_the_first_group_is_taken() -> None:
    """Two measurements of one quantity: a lead within one standard error is chance."""
    rng = torch.Generator().manual_seed(4)
    y = torch.randn(60, 1, generator=rng)
    part = TargetPart("numbers", torch.zeros(0, 1), torch.zeros(0, 1), ("n",))

    def weights(*noise: float) -> tuple[float, ...]:
        x = torch.cat([y + each * torch.randn(60, 1, generator=rng) for each in noise], 1)
        kernels = group_kernels(x, torch.zeros(1, len(noise)), [1] * len(noise))
        return choose_weights(part, kernels, y, places_of([str(i // 2) for i in range(60)]))

    # the very best weights are nearly even here: two measurements are better than one
    assert weights(0.3, 0.9)[0] >= 0.75
    assert weights(0.3, 0.3, 0.3)[0] < 1
    assert weights(2.0, 0.1) == (0.0, 1.0)


def test_weights_are_found_beside_a_group_in_which_nothing_varies() -> None:
    rng = torch.Generator().manual_seed(0)
    y = torch.randn(30, 1, generator=rng)
    part = TargetPart("numbers", torch.zeros(0, 1), torch.zeros(0, 1), ("n",))
    places = places_of([str(i) for i in range(30)])
    told, still = y + 0.1 * torch.randn(30, 3, generator=rng), torch.ones(30, 4)

    def weights(*groups: Tensor) -> tuple[float, ...]:
        x, sizes = torch.cat(groups, 1), [len(group.T) for group in groups]
        return choose_weights(part, group_kernels(x, x[:1], sizes), y, places)

    assert weights(told, still) == (1.0, 0.0)
    assert weights(still, told)[1] > 0
    assert sum(weights(still, still)) == 1
