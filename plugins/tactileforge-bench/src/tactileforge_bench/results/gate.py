"""The release gate: a model against everything free of trained touch, beyond the interval.

Intervals are those of `results.bootstrap`: paired, over recordings or objects.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from tactileforge_bench.results.bootstrap import (
    METRICS,
    GroupedScore,
    ScoreInterval,
    compared,
    compared_over_tasks,
    grouped_score,
)
from tactileforge_bench.results.release_gate import COMPARED, MEAN, without_largest
from tactileforge_bench.results.results import Results, ResultTask

#: What a model has to beat; ``random`` are its own architecture's.
AGAINST = ("random", "pixels")
#: Baselines, besides ``untrained:NAME``. Those that can be read in several ways are compared with
#: at their best: photographs' groups have the free groups, pictures and statistics, too.
_BASELINES = ("pixels", "statistics", "imagenet", "motion", "hog", "background", "chance")
#: Tallies of the networks of a task by model and reading.
_Cells = Mapping[tuple[str, str], list[GroupedScore]]


@dataclass(frozen=True)
class GateRow:
    """A model in a task, with one kind of features.

    Attributes:
        task: Name of the task; `MEAN` for all of them together.
        model: Name of the model.
        reading: Features for the probe; see `Ridge.readings`.
        score: Score of the model.
        above: Lead over ``random``, baselines and other models, by name.
        without: In the row of all tasks, the leads of ``value`` over each of `COMPARED` without the
            task that carries most of it.
    """

    task: str
    model: str
    reading: str
    score: ScoreInterval
    above: Mapping[str, ScoreInterval] = field(default_factory=dict)
    without: Mapping[str, float] = field(default_factory=dict)

    @property
    def beats(self) -> bool:
        """Whether it beats random weights and pixels, both beyond the interval."""
        return all(name in self.above and self.above[name].low > 0 for name in AGAINST)


def gate_tasks(results: Results) -> list[ResultTask]:
    """Tasks with a sum over clips as main metric; the gate can judge no others."""
    return [task for task in results.tasks if task.main in METRICS]


def left_out(results: Results) -> dict[str, str]:
    """Main metrics of tasks outside the gate, by name; see `gate_tasks`."""
    return {task.name: task.main for task in results.tasks if task.main not in METRICS}


def compute_gate(folder: Path, results: Results) -> list[GateRow]:
    """Rows of the gate: every model in every task and in their mean, with each kind of features.

    Args:
        folder: Folder of a bench.
        results: Results of the bench.
    """
    gate_rows = []
    by_task = {task.name: _cells(folder, results, task) for task in gate_tasks(results)}
    scores = {
        (name, *key): compared(networks)
        for name, cells in by_task.items()
        for key, networks in cells.items()
    }
    # in the order of the tasks: the seed of a task's draws is its place in the mean
    counted = {task.name: by_task[task.name] for task in gate_tasks(results) if task.counted}
    judged = counted or by_task
    best = best_readings({key: one.value for key, one in scores.items() if key[0] in judged})
    for name, cells in by_task.items():
        for model in results.models:
            for reading in dict.fromkeys(key[1] for key in cells if key[0] == model.name):
                networks = cells[model.name, reading]
                above = {
                    other: compared(networks, tallies)
                    for other, tallies in _others(cells, model.name, reading, best).items()
                }
                score = scores[name, model.name, reading]
                gate_rows.append(GateRow(name, model.name, reading, score, above))
    means = [
        _mean_row(counted, row, best) for row in gate_rows if row.task == next(iter(counted), "")
    ]
    return gate_rows + [row for row in means if row and len(counted) > 1]


def best_readings(values: Mapping[tuple[str, str, str], float]) -> dict[str, str]:
    """The reading of each baseline with the highest sum over tasks, by name.

    Args:
        values: Scores by task, model and reading; readings absent from a task are left out.
    """
    tasks = {task for task, _, _ in values}
    best: dict[str, tuple[float, str]] = {}
    for name, reading in {(name, reading) for _, name, reading in values if name in _BASELINES}:
        if all((task, name, reading) in values for task in tasks):
            total = sum(values[task, name, reading] for task in sorted(tasks))
            best[name] = max(best.get(name, (total, reading)), (total, reading))
    return {name: best[name][1] for name in _BASELINES if name in best}


def _mean_row(
    by_task: Mapping[str, _Cells], row: GateRow, best: Mapping[str, str]
) -> GateRow | None:
    """The row of all counted tasks; None where the model was not run on one of them."""
    key = row.model, row.reading
    every = list(by_task.values())
    if any(key not in cells for cells in every):
        return None
    others = [_others(cells, row.model, row.reading, best) for cells in every]
    named = [name for name in row.above if all(name in other for other in others)]
    pairs = {
        name: [(cells[key], other[name]) for cells, other in zip(every, others, strict=True)]
        for name in named
    }
    above = {name: compared_over_tasks(tasks) for name, tasks in pairs.items()}
    without = {
        name: without_largest([compared(*task).value for task in pairs[name]])
        for name in COMPARED
        if name in pairs
    }
    score = compared_over_tasks([(cells[key], ()) for cells in every])
    return GateRow(MEAN, row.model, row.reading, score, above, without)


def _cells(folder: Path, results: Results, task: ResultTask) -> _Cells:
    tallies: dict[tuple[str, str], list[GroupedScore]] = {}
    for cell in results.cells:
        if cell.task == task.name and (reading := str(cell.setting.get("reading", ""))):
            tallies.setdefault((cell.model, reading), []).append(
                grouped_score(folder / cell.predictions, task.main)
            )
    return tallies


def _others(
    cells: _Cells, model: str, reading: str, best: Mapping[str, str]
) -> dict[str, list[GroupedScore]]:
    """Tallies of a model's competitors: baselines at their best, and other models read alike."""
    if is_baseline(model):
        return {}
    # random weights are read alike: another reading would be compared with another feature
    random = cells.get((f"untrained:{model}", reading))
    others = {"random": random} if random else {}
    for name in _BASELINES:
        if (name, best.get(name, "")) in cells:
            others[name] = cells[name, best[name]]
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
    (``mean_above``), in value still without the task that carries most of each lead
    (``carried_by_one``), and no task is below random weights beyond it (``below_random``).

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
        without = means[reading].without if reading in means else {}
        carried = [name for name in COMPARED if without.get(name, 1.0) <= 0]
        out[reading] |= {"mean_above": above, "carried_by_one": carried}
        if above == list(COMPARED) and not below and not carried:
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
    means = [row for row in gate_rows if row.task == MEAN]
    return {
        "suite": results.suite,
        "versions": dict(results.versions),
        "baselines_read_by": best_readings(
            {(MEAN, row.model, row.reading): row.score.value for row in means}
        ),
        "tasks": {
            task.name: {"title": task.title, "metric": task.main, "counted": task.counted}
            for task in gate_tasks(results)
        }
        | {MEAN: {"title": "Mean of all tasks", "metric": MEAN}},
        "left_out": left_out(results),
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
            | ({"without": {k: round(v, 4) for k, v in row.without.items()}} if row.without else {})
            for row in gate_rows
        ],
    }


def _score(score: ScoreInterval) -> dict[str, float]:
    return {key: round(getattr(score, key), 4) for key in ("value", "low", "high")}
