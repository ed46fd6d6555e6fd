"""The release gate: compares a model with random weights and raw pixels, beyond the interval.

Every test clip is scored, clips of one recording (or object) are drawn together, with replacement,
and differences are taken within a draw: the paired bootstrap over groups, by percentiles. Of random
weights one network is drawn each time too, so that their spread counts.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactileforge.bench.results.predictions import read_predictions
from tactileforge.bench.results.results import Cell, Results, ResultTask
from tactileforge.errors import DataError

FILE = "gate.json"
#: What a model has to beat; ``random`` are its own architecture's.
AGAINST = ("random", "pixels")
DRAWS = 2000
#: Words of models that are compared with, besides ``untrained:NAME``.
_BASELINES = ("pixels", "statistics", "motion", "hog", "background", "chance")
#: Name of the row of all tasks together, whose metrics are all 1 at best.
MEAN = "mean"
_SEED = 20261122

Sums = NDArray[np.float64]


@dataclass(frozen=True)
class GroupedScore:
    """A score as sums over groups, so that the bootstrap over groups is a matrix product.

    The score is ``start + sign * mean_k(top_k / bottom_k)``, tops and bottoms summed over groups.

    Attributes:
        groups: Names, in the order of the rows.
        top: float64 (groups, k).
        bottom: float64 (groups, k).
        start: 0, or 1 for a coefficient of determination.
        sign: 1, or -1 for that.
    """

    groups: tuple[str, ...]
    top: Sums
    bottom: Sums
    start: float
    sign: float

    def scores(self, counts: Sums) -> Sums:
        """Scores (draws,) from the number of times each group was drawn, (draws, groups)."""
        top, bottom = counts @ self.top, counts @ self.bottom
        # a draw may miss a class entirely: its recall is left out of the mean
        there = bottom > 0
        share = np.divide(top, bottom, out=np.zeros_like(top), where=there)
        scores: Sums = self.start + self.sign * share.sum(1) / np.maximum(there.sum(1), 1)
        return scores


def grouped_score(path: Path, metric: str) -> GroupedScore:
    """Scores of the test clips of a cell.

    Args:
        path: Its predictions.
        metric: ``accuracy``, ``balanced_accuracy`` or ``r2``.

    Raises:
        DataError: The file does not say which clips belong together, or the metric is another.
    """
    predictions = read_predictions(path)
    with np.load(path, allow_pickle=False) as file:
        if "units" not in file.files:
            raise DataError(f"{path}: array 'units' is missing; run the bench again")
        names, of = np.unique(file["units"], return_inverse=True)
    if metric == "r2":
        # deviations are from the mean of all clips, not of a draw: else they do not sum over groups
        truth = predictions.truth.astype(float)
        error = (predictions.predicted - predictions.truth).astype(float)
        parts = error**2, (truth - truth.mean(0)) ** 2
    elif metric in ("accuracy", "balanced_accuracy"):
        # one column per class gives the mean recall, one column for all the accuracy
        right = (predictions.truth == predictions.predicted).astype(float)
        per_class = predictions.truth[:, :1] == np.unique(predictions.truth)
        classes = per_class if metric != "accuracy" else [[True]]
        parts = right * classes, np.ones_like(right) * classes
    else:
        raise DataError(f"{path}: the gate knows accuracy, balanced_accuracy and r2, not {metric}")
    sums = [np.zeros((len(names), part.shape[1])) for part in parts]
    for total, part in zip(sums, parts, strict=True):
        np.add.at(total, of, part)
    start, sign = (1.0, -1.0) if metric == "r2" else (0.0, 1.0)
    return GroupedScore(tuple(names.tolist()), sums[0], sums[1], start, sign)


@dataclass(frozen=True)
class GateScore:
    """A score, or a difference of two, with its 95 % interval.

    Attributes:
        value: The score; of classes as a share.
        low: Lower end.
        high: Upper end.
    """

    value: float
    low: float
    high: float


def compared(tallies: Sequence[GroupedScore], others: Sequence[GroupedScore] = ()) -> GateScore:
    """Mean score of some networks, or its difference to that of others, by the bootstrap.

    Args:
        tallies: A tally each.
        others: Alike; none to give the score itself.

    Raises:
        DataError: They were not tested on the same groups.
    """
    value, draws = _bootstrap(tallies, others)
    return _interval(value, draws)


def compared_over_tasks(
    tasks: Sequence[tuple[Sequence[GroupedScore], Sequence[GroupedScore]]],
) -> GateScore:
    """Mean over tasks of what `compared` gives for each; tasks are drawn from independently.

    Args:
        tasks: Networks and others of each task; see `compared`.

    Raises:
        DataError: See `compared`.
    """
    parts = [_bootstrap(*task, seed=_SEED + number) for number, task in enumerate(tasks)]
    return _interval(
        float(np.mean([value for value, _ in parts])), np.mean([draws for _, draws in parts], 0)
    )


def _interval(value: float, draws: Sums) -> GateScore:
    low, high = np.quantile(draws, (0.025, 0.975))
    return GateScore(value, float(low), float(high))


def _bootstrap(
    tallies: Sequence[GroupedScore], others: Sequence[GroupedScore] = (), seed: int = _SEED
) -> tuple[float, Sums]:
    """Mean score or difference, and those of ``DRAWS`` draws; see `compared`."""
    every = [*tallies, *others]
    groups = every[0].groups
    if any(network.groups != groups for network in every):
        raise DataError("models were tested on other recordings; run the bench again, all at once")
    rng = np.random.default_rng(seed)
    # the same draws of groups for all networks: the test is paired
    counts = rng.multinomial(len(groups), np.full(len(groups), 1 / len(groups)), DRAWS)
    all_once = np.ones((1, len(groups)))

    def drawn(networks: Sequence[GroupedScore]) -> Sums:
        table = np.stack([network.scores(counts.astype(float)) for network in networks])
        # networks are drawn too, so that the interval covers the spread of seeds
        chosen = rng.integers(len(networks), size=(len(networks), DRAWS))
        means: Sums = np.take_along_axis(table, chosen, axis=0).mean(0)
        return means

    values = drawn(tallies) - drawn(others) if others else drawn(tallies)
    mean = np.mean([network.scores(all_once) for network in tallies])
    mean -= np.mean([network.scores(all_once) for network in others]) if others else 0.0
    return float(mean), values


@dataclass(frozen=True)
class GateRow:
    """A model in a task, with one kind of features.

    Attributes:
        task: Name of the task; `MEAN` for all of them together.
        model: Name of the model.
        reading: What the probe read; see `Ridge.readings`.
        score: Its score.
        above: What it is above what it is compared with, by name.
    """

    task: str
    model: str
    reading: str
    score: GateScore
    above: Mapping[str, GateScore] = field(default_factory=dict)

    @property
    def beats(self) -> bool:
        """Whether it beats random weights and pixels, both beyond the interval."""
        return all(name in self.above and self.above[name].low > 0 for name in AGAINST)


def compute_gate(folder: Path, results: Results) -> list[GateRow]:
    """Rows of the gate: every model in every task and in their mean, with each kind of features.

    Args:
        folder: Of a bench.
        results: What it left.
    """
    gate_rows = []
    by_task = {task.name: _cells(folder, results, task) for task in results.tasks}
    for name, cells in by_task.items():
        for model in results.models:
            for reading in dict.fromkeys(key[1] for key in cells if key[0] == model.name):
                networks = cells[model.name, reading]
                above = {
                    other: compared(networks, tallies)
                    for other, tallies in _others(cells, model.name, reading).items()
                }
                gate_rows.append(GateRow(name, model.name, reading, compared(networks), above))
    means = [_mean_row(by_task, row) for row in gate_rows if row.task == next(iter(by_task))]
    return gate_rows + [row for row in means if row and len(by_task) > 1]


def _mean_row(
    by_task: Mapping[str, Mapping[tuple[str, str], list[GroupedScore]]], row: GateRow
) -> GateRow | None:
    """The row of all tasks; None where the model was not run on one of them."""
    key = row.model, row.reading
    every = list(by_task.values())
    if any(key not in cells for cells in every):
        return None
    others = [_others(cells, row.model, row.reading) for cells in every]
    above = {
        name: compared_over_tasks(
            [(cells[key], other[name]) for cells, other in zip(every, others, strict=True)]
        )
        for name in row.above
        if all(name in other for other in others)
    }
    score = compared_over_tasks([(cells[key], ()) for cells in every])
    return GateRow(MEAN, row.model, row.reading, score, above)


def _cells(
    folder: Path, results: Results, task: ResultTask
) -> dict[tuple[str, str], list[GroupedScore]]:
    tallies: dict[tuple[str, str], list[GroupedScore]] = {}
    for cell in results.cells:
        if cell.task == task.name and (reading := str(cell.setting.get("reading", ""))):
            tallies.setdefault((cell.model, reading), []).append(_of(folder, cell, task))
    return tallies


def _of(folder: Path, cell: Cell, task: ResultTask) -> GroupedScore:
    return grouped_score(folder / cell.predictions, task.main)


def _others(
    cells: Mapping[tuple[str, str], list[GroupedScore]], model: str, reading: str
) -> dict[str, list[GroupedScore]]:
    """Tallies of the baselines of a model; baselines have one kind of features for both."""
    if is_baseline(model):
        return {}
    random = cells.get((f"untrained:{model}", reading))
    others = {"random": random} if random else {}
    for name in _BASELINES:
        if (name, "pooled") in cells:
            others[name] = cells[name, "pooled"]
    return others


def is_baseline(name: str) -> bool:
    """Whether the model of a row is untrained."""
    return name in _BASELINES or name.startswith("untrained:")


def gate_outcome(gate_rows: Sequence[GateRow], model: str) -> dict[str, Any]:
    """Tasks won with each kind of features, and whether they are the majority with all."""
    rows = [row for row in gate_rows if row.model == model and row.task != MEAN]
    out: dict[str, Any] = {"passes": bool(rows)}
    for reading in dict.fromkeys(row.reading for row in rows):
        readings = [row for row in rows if row.reading == reading]
        won = [row.task for row in readings if row.beats]
        out[reading] = {"tasks": len(readings), "won": won}
        out["passes"] &= 2 * len(won) > len(readings)
    return out


def gate_to_plain(gate_rows: Sequence[GateRow], results: Results) -> dict[str, Any]:
    """The gate as plain data, for ``gate.json`` and for cards."""
    models = [model for model in results.models if not is_baseline(model.name)]
    return {
        "suite": results.suite,
        "versions": dict(results.versions),
        "tasks": {task.name: {"title": task.title, "metric": task.main} for task in results.tasks}
        | {MEAN: {"title": "Mean of all tasks", "metric": MEAN}},
        "models": {
            model.name: gate_outcome(gate_rows, model.name)
            | {key: model.facts.get(key, []) for key in ("trained_on", "seen_of_held_out")}
            | {"sha256": model.sha256}
            for model in models
        },
        "rows": [
            {"task": row.task, "model": row.model, "reading": row.reading, **_score(row.score)}
            | {"above": {name: _score(difference) for name, difference in row.above.items()}}
            | ({"beats": row.beats} if row.above else {})
            for row in gate_rows
        ],
    }


def _score(score: GateScore) -> dict[str, float]:
    return {key: round(getattr(score, key), 4) for key in ("value", "low", "high")}
