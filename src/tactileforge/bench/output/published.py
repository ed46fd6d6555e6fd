"""Published numbers of the cards of the zoo, kept apart from measured ones."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

from tactileforge.bench.output.comparison_tables import Columns, digits_of, main_models
from tactileforge.bench.output.grid import Entry, Grid, Head, plus_minus
from tactileforge.bench.results.results import Results, Task
from tactileforge.bench.results.scores import Scores, titles
from tactileforge.hub import cards


@dataclass(frozen=True)
class Published:
    """One number of a card.

    Attributes:
        model: Full name of the weights, ``card.tag``.
        task: Benchmark, task and sensor.
        metric: What was measured.
        value: The number.
        unit: Of the number.
        source: Where it can be looked up.
    """

    model: str
    task: str
    metric: str
    value: float
    unit: str
    source: str


def of_zoo() -> list[Published]:
    """Published numbers of all cards, in the order of their names."""
    return [
        Published(f"{card.name}.{r.model}", r.task, r.metric, r.value, r.unit, r.source)
        for card in map(cards.read, cards.names())
        for r in card.results
        if not r.is_ours
    ]


def same(ours: str, theirs: str) -> bool:
    """Whether two names are equal up to case, punctuation and the word ``of``.

    Example:
        >>> same("rmse_sum_axes", "RMSE, sum of axes")
        True
    """
    first, second = (
        [word for word in re.findall(r"[a-z0-9]+", name.lower()) if word != "of"]
        for name in (ours, theirs)
    )
    return first == second


def published_table(rows: Sequence[Published]) -> Grid | None:
    """Tasks by models; None where there are no numbers."""
    if not rows:
        return None
    models = list(dict.fromkeys(row.model for row in rows))
    tasks = list(dict.fromkeys((row.task, row.metric, row.unit) for row in rows))
    values = {(row.task, row.metric, row.unit, row.model): f"{row.value:g}" for row in rows}
    sources = "; ".join(dict.fromkeys(row.source for row in rows))
    entries = [
        [
            Entry(f"{task}: {metric}{f' ({unit})' if unit else ''}"),
            *(
                Entry(value) if (value := values.get((task, metric, unit, model))) else _NONE
                for model in models
            ),
        ]
        for task, metric, unit in tasks
    ]
    return Grid(
        name="published",
        title="Published numbers, not ours",
        caption=f"As printed in: {sources}. Nothing here was measured by this bench.",
        head=[Head("Task"), *map(Head, models)],
        rows=entries,
    )


_NONE = Entry("not published", tone="soft")


def of_task(task: Task, rows: Sequence[Published]) -> list[tuple[Published, str]]:
    """Published numbers for the same task and one of its metrics, with our name of the metric."""
    return [
        (row, metric.name)
        for row in rows
        if same(task.title, row.task)
        for metric in task.metrics
        if same(metric.name, row.metric) and metric.unit == row.unit
    ]


def beside_tables(results: Results, all_scores: Scores, rows: Sequence[Published]) -> list[Grid]:
    """Measured beside published numbers: a table for each task and metric that both have."""
    grids = []
    for task in results.tasks:
        pairs = of_task(task, rows)
        for metric in dict.fromkeys(name for _, name in pairs):
            theirs = {row.model: row for row, name in pairs if name == metric}
            grid = _beside(Columns(results, all_scores), task, metric, theirs)
            grids += [grid] if grid else []
    return grids


def _beside(table: Columns, task: Task, metric: str, theirs: dict[str, Published]) -> Grid | None:
    """A table of measured beside published numbers; None without a measured one."""
    models = {model.name: model for model in main_models(table.results)}
    scores = {name: table.score(task, model) for name, model in models.items()}
    ours = {name: score.interval(metric) if score else None for name, score in scores.items()}
    if not any(ours.values()):
        return None
    digits, names = digits_of(list(ours.values())), titles(table.results)
    entries = []
    for name in dict.fromkeys((*models, *theirs)):
        score, interval, other = scores.get(name), ours.get(name), theirs.get(name)
        left = Entry("not in this bench", tone="soft")
        if score and interval:
            left = Entry(plus_minus(interval, digits), marks=table.marks(score, metric))
        elif name in models:
            left = table.without(task, models[name], score, metric)
        right = Entry(f"{other.value:g}") if other else _NONE
        source = Entry(other.source if other else "no source", tone="text")
        entries.append([Entry(names.get(name, name)), left, right, source])
    unit = task.metric(metric).unit
    return Grid(
        name=f"beside-{task.name}-{metric}",
        title=f"Ours beside published: {task.title}",
        caption=(
            f"{metric}{f' ({unit})' if unit else ''}. Published numbers may come from another "
            "split or epoch, and take no part in the marks of our tables."
        ),
        head=[Head("Model"), Head("ours"), Head("published"), Head("source")],
        rows=entries,
        notes=table.notes.items(),
    )
