"""The release gate: its rows, and its conditions."""

import json
from dataclasses import replace
from pathlib import Path

import pytest
from made_predictions import classes
from tactileforge_bench.output import gate_table
from tactileforge_bench.results import gate
from tactileforge_bench.results.gate import gate_outcome
from tactileforge_bench.results.release_gate import MEAN
from tactileforge_bench.results.results import Cell, ResultMetric, ResultModel, Results, ResultTask


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
    """Values of three networks for random cells; baselines have one value."""
    score = []
    of_baseline = dict.fromkeys(("pixels", "chance", "statistics"), ("pooled",))
    of_baseline |= {"imagenet": ("pooled", "summary")}
    for reading in of_baseline.get(model, ("pooled", "patches")):
        for number in range(3 if model.startswith("untrained") else 1):
            file = f"{task.name}-{model.replace(':', '_')}-{reading}-{number}"
            path = classes(folder, file, share, seed + number, 300)
            cell = Cell(task=task.name, model=model, seed=number, metrics={"accuracy": 100 * share})
            place = path.relative_to(folder).as_posix()
            score.append(replace(cell, setting={"reading": reading}, predictions=place))
    return score


def bench(folder: Path, right: float, count: int = 3, **models: float) -> Results:
    """A model against random weights of .5, pixels of .6 and other models."""
    tasks = [task(f"t{i}") for i in range(count)]
    shares = {"m": right, "untrained:m": 0.5, "pixels": 0.6, "chance": 0.5}
    shares |= {"statistics": 0.55, "imagenet": 0.5, **models}
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


@pytest.mark.slow
@pytest.mark.parametrize(("right", "wins"), [(0.9, 3), (0.6, 0), (0.3, 0)])
def test_who_is_better_passes(right: float, wins: int, tmp_path: Path) -> None:
    results = bench(tmp_path, right)
    rows = gate_table.write_gate(tmp_path, results)
    score = gate_outcome(rows, "m")
    assert score["passes"] == (["pooled", "patches"] if wins else [])
    assert [len(score[reading]["won"]) for reading in ("pooled", "patches")] == [wins, wins]
    lost = ["t0", "t1", "t2"] if right < 0.5 else []
    assert [score[reading]["below_random"] for reading in ("pooled", "patches")] == [lost, lost]
    plain = json.loads((tmp_path / "gate.json").read_text())
    assert list(plain["models"]) == ["m"]
    row = next(row for row in plain["rows"] if row["model"] == "m")
    assert row["above"]["random"]["value"] == pytest.approx(right - 0.5, abs=0.1)
    assert row["above"]["pixels"]["value"] == pytest.approx(right - 0.6, abs=0.1)
    grid = gate_table.gate_table(rows, results)
    assert grid is not None
    marks = {("▲" in entry.text, "▼" in entry.text) for entry in grid.rows[0][2:-1]}
    assert marks == {(right == 0.9, right == 0.3)}
    verdict = grid.rows[0][-1].text
    assert (verdict == "yes") == (right == 0.9)
    assert ("below random weights: T0, T1, T2" in verdict) == (right == 0.3)
    assert [row[-1].text for row in grid.rows if row[0].text != "m"] == [""] * (len(grid.rows) - 2)


@pytest.mark.slow
def test_one_task_below_random_weights_is_enough_to_fail(tmp_path: Path) -> None:
    rows = gate.compute_gate(tmp_path, bench(tmp_path, 0.9))
    worse = gate.compute_gate(tmp_path, bench(tmp_path, 0.3))
    mixed = [row for row in rows if row.task != "t0"] + [row for row in worse if row.task == "t0"]
    assert gate_outcome(rows, "m")["passes"]
    assert not gate_outcome(mixed, "m")["passes"]
    assert gate_outcome(mixed, "m", uncounted=["t0"])["passes"]
    assert not gate_outcome([], "m")["passes"]


@pytest.mark.slow
def test_models_of_one_bench_are_compared_with_each_other(tmp_path: Path) -> None:
    rows = gate.compute_gate(tmp_path, bench(tmp_path, 0.9, count=2, other=0.7))
    found = {(row.task, row.model, row.reading): row.above for row in rows}
    for name in ("t0", "t1", MEAN):
        for reading in ("pooled", "patches"):
            above = found[name, "m", reading]["other"]
            below = found[name, "other", reading]["m"]
            assert above.value == pytest.approx(0.2, abs=0.1)
            assert above.low > 0 > below.high
            assert below.value == pytest.approx(-above.value)
    assert not found["t0", "pixels", "pooled"]


@pytest.mark.slow
def test_a_task_whose_metric_is_no_sum_over_clips_stays_out(tmp_path: Path) -> None:
    """A bench of closed-form probes may have such tasks, and ends all the same."""
    results = bench(tmp_path, 0.9)
    metric = ResultMetric(name="rmse_sum_axes", unit="mN", better="lower")
    other = replace(results.tasks[1], metrics=[metric], main=metric.name)
    results = replace(results, tasks=[results.tasks[0], other, results.tasks[2]])
    rows = gate_table.write_gate(tmp_path, results)
    assert {row.task for row in rows} == {"t0", "t2", MEAN}
    assert gate_outcome(rows, "m")["pooled"]["tasks"] == 2
    grid = gate_table.gate_table(rows, results)
    assert grid is not None
    assert [head.text for head in grid.head][2:-2] == ["T0", "T2"]
    plain = json.loads((tmp_path / "gate.json").read_text())
    assert list(plain["tasks"]) == ["t0", "t2", "mean"]
    assert plain["left_out"] == {"t1": "rmse_sum_axes"}
    assert grid.caption.endswith("is not a sum over clips: T1 (rmse_sum_axes).")


def test_without_all_baselines_nothing_is_said_of_passing(tmp_path: Path) -> None:
    results = bench(tmp_path, 0.9, count=2)
    models = [one for one in results.models if one.name not in ("statistics", "imagenet")]
    named = {model.name for model in models}
    few = replace(results, models=models, cells=[c for c in results.cells if c.model in named])
    for some, lacks in (
        (few, "picture statistics, photographs with all that is free"),
        (replace(results, tasks=results.tasks[:1]), "a second task that counts"),
    ):
        grid = gate_table.gate_table(gate.compute_gate(tmp_path, some), some)
        assert grid is not None
        assert grid.title == "Beside what is free: real"
        assert f"The release gate needs {lacks} too." in grid.caption
        assert "passes" not in [head.text for head in grid.head]
        assert {len(row) for row in grid.rows} == {len(grid.head)}


@pytest.mark.slow
def test_a_task_that_does_not_count_is_told_and_no_more(tmp_path: Path) -> None:
    """It is neither won nor in the mean of the tasks, two of them right in 90 of 100."""
    results = bench(tmp_path, 0.9)
    before = {row.task: row for row in gate.compute_gate(tmp_path, results) if row.model == "m"}
    cells(tmp_path, results.tasks[1], "m", 0.1, 5)  # in place of what it predicted
    tasks = [replace(task, counted=task.name != "t1") for task in results.tasks]
    results = replace(results, tasks=tasks)
    rows = gate_table.write_gate(tmp_path, results)
    found = {row.task: row for row in rows if row.model == "m" and row.reading == "pooled"}
    assert found["t1"].score.value == pytest.approx(0.1, abs=0.05)
    counted = [before[name].score.value for name in ("t0", "t2")]
    assert found[MEAN].score.value == pytest.approx(sum(counted) / 2, abs=0.01)
    plain = json.loads((tmp_path / "gate.json").read_text())
    assert plain["models"]["m"]["pooled"]["tasks"] == 2
    assert plain["models"]["m"]["passes"]
    assert [plain["tasks"][name]["counted"] for name in ("t0", "t1", "t2")] == [True, False, True]
    grid = gate_table.gate_table(rows, results)
    assert grid is not None
    assert [head.text for head in grid.head][2:5] == ["T0", "(T1)", "T2"]
    assert grid.rows[0][-1].text == "yes"


@pytest.mark.slow
@pytest.mark.parametrize(("share", "above"), [(0.7, True), (0.95, False)])
def test_the_mean_is_compared_with_photographs_alone(
    share: float, above: bool, tmp_path: Path
) -> None:
    """With their summary, whatever the model is read by."""
    results = bench(tmp_path, 0.85, imagenet=share)
    rows = gate_table.write_gate(tmp_path, results)
    mean = next(row for row in rows if (row.task, row.model) == (MEAN, "m"))
    assert mean.above["imagenet"].value == pytest.approx(0.85 - share, abs=0.1)
    outcome = gate_outcome(rows, "m")["patches"]
    assert ("imagenet" in outcome["mean_above"]) == above
    assert {"random", "pixels"} <= set(outcome["mean_above"])
    assert "imagenet" not in json.loads((tmp_path / "gate.json").read_text())["models"]
