"""The release gate: scores and intervals against closed forms, and what passes."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tactileforge.bench.output import gate_table
from tactileforge.bench.results import gate
from tactileforge.bench.results.gate import (
    GroupedScore,
    compared,
    compared_over_tasks,
    gate_outcome,
    grouped_score,
)
from tactileforge.bench.results.results import Cell, ResultMetric, ResultModel, Results, ResultTask
from tactileforge.errors import DataError


def predictions(folder: Path, name: str, **arrays: Any) -> Path:
    path = folder / "predictions" / f"{name}.npz"
    path.parent.mkdir(exist_ok=True)
    np.savez(path, **arrays)
    return path


def classes(folder: Path, name: str, right: float, seed: int, groups: int = 60) -> Path:
    """Three clips a group, of two classes; a share is right."""
    rng = np.random.default_rng(seed)
    truth = np.random.default_rng(0).integers(2, size=3 * groups)
    wrong = np.repeat(rng.random(groups) > right, 3)
    units = np.repeat([f"r{i}" for i in range(groups)], 3)
    predicted = np.where(wrong, 1 - truth, truth)
    return predictions(
        folder, name, truth=truth, predicted=predicted, names=np.array(["a", "b"]), units=units
    )


def test_scores_are_those_of_the_metrics(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    truth = rng.normal(size=(50, 2)).astype(np.float32)
    score = truth + rng.normal(0, 0.5, size=(50, 2)).astype(np.float32)
    units = np.array([f"b{i % 7}" for i in range(50)])
    path = predictions(tmp_path, "r2", truth=truth, predicted=score, axes=["x", "y"], units=units)
    wanted = 1 - ((score - truth) ** 2).sum(0) / ((truth - truth.mean(0)) ** 2).sum(0)
    assert compared([grouped_score(path, "r2")]).value == pytest.approx(wanted.mean(), abs=1e-6)

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
    """Two models that err on the same recordings, but for a few."""
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
    assert compared([tallied], [tallied]) == gate.GateScore(0.0, 0.0, 0.0)


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


def task(name: str) -> ResultTask:
    metric = ResultMetric(name="accuracy", unit="%", better="higher")
    return ResultTask(
        name=name,
        title=name.upper(),
        probe="ridge",
        data="made",
        split="folds",
        metrics=[metric],
        main="accuracy",
        selection="validation",
    )


def cells(folder: Path, task: ResultTask, model: str, share: float, seed: int) -> list[Cell]:
    """Of three networks where they are random; baselines have one reading."""
    score = []
    for reading in ("pooled",) if model in ("pixels", "chance") else ("pooled", "patches"):
        for number in range(3 if model.startswith("untrained") else 1):
            file = f"{task.name}-{model.replace(':', '_')}-{reading}-{number}"
            path = classes(folder, file, share, seed + number, 300)
            cell = Cell(task=task.name, model=model, seed=number, metrics={"accuracy": 100 * share})
            place = path.relative_to(folder).as_posix()
            score.append(replace(cell, setting={"reading": reading}, predictions=place))
    return score


def bench(folder: Path, right: float, count: int = 3) -> Results:
    """A model against random weights of .5 and pixels of .6."""
    tasks = [task(f"t{i}") for i in range(count)]
    shares = {"m": right, "untrained:m": 0.5, "pixels": 0.6, "chance": 0.5}
    made = [
        cell
        for i, score in enumerate(tasks)
        for j, (model, share) in enumerate(shares.items())
        for cell in cells(folder, score, model, share, 1000 * j + 10 * i)
    ]
    models = [ResultModel(name=name, title=name) for name in shares]
    return Results(
        suite="real",
        versions={},
        settings={},
        tasks=tasks,
        models=models,
        cells=made,
        training=[],
        not_run=[],
    )


@pytest.mark.parametrize(("right", "wins"), [(0.9, 3), (0.6, 0), (0.3, 0)])
def test_who_is_better_passes(right: float, wins: int, tmp_path: Path) -> None:
    results = bench(tmp_path, right)
    rows = gate_table.write_gate(tmp_path, results)
    score = gate_outcome(rows, "m")
    assert score["passes"] == (wins > 1)
    assert [len(score[reading]["won"]) for reading in ("pooled", "patches")] == [wins, wins]
    plain = json.loads((tmp_path / "gate.json").read_text())
    assert list(plain["models"]) == ["m"]
    row = next(row for row in plain["rows"] if row["model"] == "m")
    assert row["above"]["random"]["value"] == pytest.approx(right - 0.5, abs=0.1)
    assert row["above"]["pixels"]["value"] == pytest.approx(right - 0.6, abs=0.1)
    grid = gate_table.gate_table(rows, results)
    assert grid is not None
    marks = {("▲" in entry.text, "▼" in entry.text) for entry in grid.rows[0][2:-1]}
    assert marks == {(right == 0.9, right == 0.3)}


def test_one_task_of_three_is_no_majority(tmp_path: Path) -> None:
    rows = gate.compute_gate(tmp_path, bench(tmp_path, 0.9))
    worse = gate.compute_gate(tmp_path, bench(tmp_path, 0.6))
    mixed = [row for row in rows if row.task == "t0"] + [row for row in worse if row.task != "t0"]
    assert not gate_outcome(mixed, "m")["passes"]
    assert not gate_outcome([], "m")["passes"]
