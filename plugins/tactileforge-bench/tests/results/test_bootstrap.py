"""Scores and intervals of the bootstrap against closed forms."""

from pathlib import Path

import numpy as np
import pytest
from made_predictions import classes, predictions
from tactileforge_bench.results.bootstrap import (
    GroupedScore,
    ScoreInterval,
    compared,
    compared_over_tasks,
    grouped_score,
)

from tactileforge.errors import DataError


def test_scores_are_those_of_the_metrics(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    truth = rng.normal(size=(50, 2)).astype(np.float32)
    score = truth + rng.normal(0, 0.5, size=(50, 2)).astype(np.float32)
    units = np.array([f"b{i % 7}" for i in range(50)])
    path = predictions(tmp_path, "r2", truth=truth, predicted=score, axes=["x", "y"], units=units)
    wanted = 1 - ((score - truth) ** 2).sum(0) / ((truth - truth.mean(0)) ** 2).sum(0)
    assert compared([grouped_score(path, "r2")]).value == pytest.approx(wanted.mean(), abs=1e-6)
    bounded = compared([grouped_score(path, "r2_bounded")])
    assert bounded == compared([grouped_score(path, "r2")])
    path = predictions(
        tmp_path, "wild", truth=truth, predicted=5 * score, axes=["x", "y"], units=units
    )
    bounded = compared([grouped_score(path, "r2_bounded")])
    assert (bounded.low, bounded.value, bounded.high) == (0, 0, 0)

    truth, score = rng.integers(3, size=90), rng.integers(3, size=90)
    path = predictions(
        tmp_path, "c", truth=truth, predicted=score, names=["a", "b", "c"], units=np.arange(90) // 3
    )
    recall = [(score[truth == k] == k).mean() for k in range(3)]
    one = grouped_score(path, "balanced_accuracy")
    assert compared([one]).value == pytest.approx(np.mean(recall), abs=1e-12)
    assert compared([grouped_score(path, "accuracy")]).value == pytest.approx(
        (truth == score).mean()
    )


def test_the_interval_is_that_of_the_binomial_over_groups(tmp_path: Path) -> None:
    """Three clips of a group are all right or all wrong: there are 60 samples, not 180."""
    score = compared([grouped_score(classes(tmp_path, "a", 0.7, 1), "accuracy")])
    expected = 1.96 * np.sqrt(score.value * (1 - score.value) / 60)
    assert score.high - score.value == pytest.approx(expected, rel=0.15)
    assert score.value - score.low == pytest.approx(expected, rel=0.15)


def test_pairs_narrow_the_difference(tmp_path: Path) -> None:
    """Two models with errors on the same recordings, but for a few."""
    paths = [classes(tmp_path, name, 0.6, 1) for name in ("a", "b")]
    with np.load(paths[1]) as file:
        arrays = dict(file)
    arrays["predicted"][:18] = arrays["truth"][:18]
    better = predictions(tmp_path, "b", **arrays)
    tallied, other = grouped_score(better, "accuracy"), grouped_score(paths[0], "accuracy")
    apart = compared([tallied], [other])
    single = compared([tallied])
    assert apart.value == pytest.approx(compared([tallied]).value - compared([other]).value)
    assert apart.high - apart.low < 0.6 * (single.high - single.low)
    assert compared([tallied], [tallied]) == ScoreInterval(0.0, 0.0, 0.0)


def test_the_mean_of_tasks_is_surer_than_each(tmp_path: Path) -> None:
    """Four tasks of equal spread: the interval of their mean is half as wide."""
    single = [grouped_score(classes(tmp_path, str(i), 0.7, i), "accuracy") for i in range(4)]
    parts = [compared([score]) for score in single]
    mean = compared_over_tasks([([score], ()) for score in single])
    assert mean.value == pytest.approx(np.mean([part.value for part in parts]))
    width = np.mean([part.high - part.low for part in parts])
    assert mean.high - mean.low == pytest.approx(width / 2, rel=0.1)


def test_the_spread_of_random_networks_counts(tmp_path: Path) -> None:
    def flat(level: float) -> GroupedScore:
        sums = np.full((40, 1), level)
        return GroupedScore(tuple(map(str, range(40))), sums, np.ones((40, 1)), 0.0, 1.0)

    score = compared([flat(0.5)], [flat(0.3), flat(0.4), flat(0.5)])
    assert score.value == pytest.approx(0.1)
    assert (score.low, score.high) == pytest.approx((0.0, 0.2))


def test_other_recordings_are_not_compared(tmp_path: Path) -> None:
    few, many = (grouped_score(classes(tmp_path, str(n), 0.5, 1, n), "accuracy") for n in (10, 12))
    with pytest.raises(DataError, match="tested on other recordings"):
        compared([few], [many])
    with pytest.raises(DataError, match="not distance"):
        grouped_score(tmp_path / "predictions" / "10.npz", "distance")
