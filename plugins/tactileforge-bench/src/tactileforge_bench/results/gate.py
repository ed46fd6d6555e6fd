"""The release gate: a model against everything free of trained touch, beyond the interval.

Intervals are those of `results.bootstrap`: paired, over recordings or objects.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from tactileforge.hub import gates
from tactileforge_bench.results.bootstrap import (
    METRICS,
    GroupedScore,
    ScoreInterval,
    compared,
    compared_over_tasks,
    grouped_score,
)
from tactileforge_bench.results.results import Results, ResultTask

FILE = "gate.json"
#: What a model has to beat; ``random`` are its own architecture's.
AGAINST = ("random", "pixels")
#: What the mean of all counted tasks is compared with: all that a user has without touch, in words.
COMPARED = {gates.BENCH_NAMES[name]: words for name, words in gates.COMPARED.items()}
#: What a probe reads of each model that is compared with, besides ``untrained:NAME``.
_BASELINES = {
    "pixels": "pooled",
    "statistics": "pooled",
    "imagenet": "summary",
    "motion": "pooled",
    "hog": "pooled",
    "background": "pooled",
    "chance": "pooled",
}
#: Name of the row of all tasks together, whose metrics are all 1 at best.
MEAN = "mean"


@dataclass(frozen=True)
class GateRow:
    """A model in a task, with one kind of features.

    Attributes:
        task: Name of the task; `MEAN` for all of them together.
        model: Name of the model.
        reading: Features for the probe; see `Ridge.readings`.
        score: Score of the model.
        above: Lead over ``random``, baselines and other models, by name.
    """

    task: str
    model: str
    reading: str
    score: ScoreInterval
    above: Mapping[str, ScoreInterval] = field(default_factory=dict)

    @property
    def beats(self) -> bool:
        """Whether it beats random weights and pixels, both beyond the interval."""
        return all(name in self.above and self.above[name].low > 0 for name in AGAINST)


def gate_tasks(results: Results) -> list[ResultTask]:
    """Tasks with a sum over clips as main metric; the gate can judge no others."""
    return [task for task in results.tasks if task.main in METRICS]


def compute_gate(folder: Path, results: Results) -> list[GateRow]:
    """Rows of the gate: every model in every task and in their mean, with each kind of features.

    Args:
        folder: Folder of a bench.
        results: Results of the bench.
    """
    gate_rows = []
    by_task = {task.name: _cells(folder, results, task) for task in gate_tasks(results)}
    for name, cells in by_task.items():
        for model in results.models:
            for reading in dict.fromkeys(key[1] for key in cells if key[0] == model.name):
                networks = cells[model.name, reading]
                above = {
                    other: compared(networks, tallies)
                    for other, tallies in _others(cells, model.name, reading).items()
                }
                gate_rows.append(GateRow(name, model.name, reading, compared(networks), above))
    # in the order of the tasks: the seed of a task's draws is its place in the mean
    counted = {task.name: by_task[task.name] for task in gate_tasks(results) if task.counted}
    means = [_mean_row(counted, row) for row in gate_rows if row.task == next(iter(counted), "")]
    return gate_rows + [row for row in means if row and len(counted) > 1]


def _mean_row(
    by_task: Mapping[str, Mapping[tuple[str, str], list[GroupedScore]]], row: GateRow
) -> GateRow | None:
    """The row of all counted tasks; None where the model was not run on one of them."""
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
            tallies.setdefault((cell.model, reading), []).append(
                grouped_score(folder / cell.predictions, task.main)
            )
    return tallies


def _others(
    cells: Mapping[tuple[str, str], list[GroupedScore]], model: str, reading: str
) -> dict[str, list[GroupedScore]]:
    """Tallies of a model's competitors: baselines in one reading each, and other models."""
    if is_baseline(model):
        return {}
    # random weights are read alike: another reading would be compared with another feature
    random = cells.get((f"untrained:{model}", reading))
    others = {"random": random} if random else {}
    for name, own_reading in _BASELINES.items():
        if (name, own_reading) in cells:
            others[name] = cells[name, own_reading]
    for (name, other_reading), tallies in cells.items():
        if other_reading == reading and name != model and not is_baseline(name):
            others[name] = tallies
    return others


def is_baseline(name: str) -> bool:
    """Whether the model of a row is untrained."""
    return name in _BASELINES or name.startswith("untrained:")


def gate_outcome(
    gate_rows: Sequence[GateRow], model: str, uncounted: Collection[str] = ()
) -> dict[str, Any]:
    """Tasks won with each kind of features, and the kinds with a pass in this suite.

    A kind passes if the mean of all counted tasks is above all of `COMPARED` beyond the interval
    (``mean_above``), and no task is below random weights beyond it (``below_random``).

    Args:
        gate_rows: Rows of all models.
        model: Name of the judged model.
        uncounted: Tasks that do not count.
    """
    rows = [row for row in gate_rows if row.model == model and row.task not in (MEAN, *uncounted)]
    means = {row.reading: row for row in gate_rows if row.model == model and row.task == MEAN}
    out: dict[str, Any] = {"passes": []}
    for reading in dict.fromkeys(row.reading for row in rows):
        readings = [row for row in rows if row.reading == reading]
        won = [row.task for row in readings if row.beats]
        random = {row.task: row.above["random"] for row in readings if "random" in row.above}
        below = [name for name, lead in random.items() if lead.high < 0]
        leads = means[reading].above if reading in means else {}
        above = [name for name in COMPARED if name in leads and leads[name].low > 0]
        out[reading] = {"tasks": len(readings), "won": won, "below_random": below}
        out[reading]["mean_above"] = above
        if above == list(COMPARED) and not below:
            out["passes"].append(reading)
    return out


def gate_outcomes(gate_rows: Sequence[GateRow], results: Results) -> dict[str, dict[str, Any]]:
    """Outcomes of all judged models by name; see `gate_outcome`."""
    uncounted = [task.name for task in gate_tasks(results) if not task.counted]
    judged = [model.name for model in results.models if not is_baseline(model.name)]
    return {name: gate_outcome(gate_rows, name, uncounted) for name in judged}


def gate_to_plain(gate_rows: Sequence[GateRow], results: Results) -> dict[str, Any]:
    """The gate as plain data, for ``gate.json`` and for cards."""
    models = {model.name: model for model in results.models}
    return {
        "suite": results.suite,
        "versions": dict(results.versions),
        "tasks": {
            task.name: {"title": task.title, "metric": task.main, "counted": task.counted}
            for task in gate_tasks(results)
        }
        | {MEAN: {"title": "Mean of all tasks", "metric": MEAN}},
        "models": {
            name: outcome
            | {key: models[name].facts.get(key, []) for key in ("trained_on", "seen_of_held_out")}
            | {"sha256": models[name].sha256}
            for name, outcome in gate_outcomes(gate_rows, results).items()
        },
        "rows": [
            {"task": row.task, "model": row.model, "reading": row.reading, **_score(row.score)}
            | {"above": {name: _score(difference) for name, difference in row.above.items()}}
            | ({"beats": row.beats} if row.above else {})
            for row in gate_rows
        ],
    }


def _score(score: ScoreInterval) -> dict[str, float]:
    return {key: round(getattr(score, key), 4) for key in ("value", "low", "high")}
