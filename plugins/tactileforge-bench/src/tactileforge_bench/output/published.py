"""Published numbers of the cards of the zoo, kept apart from measured ones."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

from tactileforge.hub import card_names, read_card
from tactileforge_bench.output.comparison_tables import Columns, digits_of, main_models
from tactileforge_bench.output.grid import ColumnHead, Table, TableEntry, plus_minus
from tactileforge_bench.results.results import Results, ResultTask
from tactileforge_bench.results.scores import Scores, titles


@dataclass(frozen=True)
class PublishedScore:
    """One number of a card.

    Attributes:
        model: Full name of the weights, ``card.tag``.
        task: Benchmark, task and sensor.
        metric: Name of the metric.
        value: The number.
        unit: Unit of the number.
        source: Reference for the number.
    """

    model: str
    task: str
    metric: str
    value: float
    unit: str
    source: str


def published_scores() -> list[PublishedScore]:
    """Published numbers of all cards, in the order of their names."""
    return [
        PublishedScore(f"{card.name}.{r.model}", r.task, r.metric, r.value, r.unit, r.source)
        for card in map(read_card, card_names())
        for r in card.results
        if not r.is_ours
    ]


def published_beside(results: Results) -> list[PublishedScore]:
    """Published numbers of the tasks of some results."""
    ours = [task.title for task in results.tasks]
    return [row for row in published_scores() if any(same_name(row.task, name) for name in ours)]


def same_name(ours: str, theirs: str) -> bool:
    """Whether two names are equal up to case, punctuation and the word ``of``.

    Example:
        >>> same_name("rmse_sum_axes", "RMSE, sum of axes")
        True
    """
    first, second = (
        [word for word in re.findall(r"[a-z0-9]+", name.lower()) if word != "of"]
        for name in (ours, theirs)
    )
    return first == second


def published_table(rows: Sequence[PublishedScore]) -> Table | None:
    """Tasks by models; None where there are no numbers."""
    if not rows:
        return None
    models = list(dict.fromkeys(row.model for row in rows))
    tasks = list(dict.fromkeys((row.task, row.metric, row.unit) for row in rows))
    values = {(row.task, row.metric, row.unit, row.model): f"{row.value:g}" for row in rows}
    sources = "; ".join(dict.fromkeys(row.source for row in rows))
    entries = [
        [
            TableEntry(f"{task}: {metric}{f' ({unit})' if unit else ''}"),
            *(
                TableEntry(value) if (value := values.get((task, metric, unit, model))) else _NONE
                for model in models
            ),
        ]
        for task, metric, unit in tasks
    ]
    return Table(
        name="published",
        title="Published numbers, not ours",
        caption=f"As printed in: {sources}. Nothing here was measured by this bench.",
        head=[ColumnHead("Task"), *map(ColumnHead, models)],
        rows=entries,
    )


_NONE = TableEntry("not published", tone="soft")


def published_for_task(
    task: ResultTask, rows: Sequence[PublishedScore]
) -> list[tuple[PublishedScore, str]]:
    """Published numbers for the same task and one of its metrics, with our name of the metric."""
    return [
        (row, metric.name)
        for row in rows
        if same_name(task.title, row.task)
        for metric in task.metrics
        if same_name(metric.name, row.metric) and metric.unit == row.unit
    ]


def beside_tables(
    results: Results, all_scores: Scores, rows: Sequence[PublishedScore]
) -> list[Table]:
    """Measured beside published numbers: a table for each shared task and metric."""
    grids = []
    for task in results.tasks:
        pairs = published_for_task(task, rows)
        for metric in dict.fromkeys(name for _, name in pairs):
            theirs = {row.model: row for row, name in pairs if name == metric}
            grid = _beside(Columns(results, all_scores), task, metric, theirs)
            grids += [grid] if grid else []
    return grids


def _beside(
    table: Columns, task: ResultTask, metric: str, theirs: dict[str, PublishedScore]
) -> Table | None:
    """A table of measured beside published numbers; None without a measured one."""
    models = {model.name: model for model in main_models(table.results)}
    scores = {name: table.score(task, model) for name, model in models.items()}
    ours = {name: score.interval(metric) if score else None for name, score in scores.items()}
    if not any(ours.values()):
        return None
    digits, names = digits_of(list(ours.values())), titles(table.results)
    entries = []
    # ours first, then models that this bench has not run
    for name in dict.fromkeys((*models, *theirs)):
        score, interval, other = scores.get(name), ours.get(name), theirs.get(name)
        left = TableEntry("not in this bench", tone="soft")
        if score and interval:
            left = TableEntry(plus_minus(interval, digits), marks=table.marks(score, metric))
        elif name in models:
            left = table.without(task, models[name], score, metric)
        right = TableEntry(f"{other.value:g}") if other else _NONE
        source = TableEntry(other.source if other else "no source", tone="text")
        entries.append([TableEntry(names.get(name, name)), left, right, source])
    unit = task.metric(metric).unit
    return Table(
        name=f"beside-{task.name}-{metric}",
        title=f"Ours beside published: {task.title}",
        caption=(
            f"{metric}{f' ({unit})' if unit else ''}. Published numbers may come from another "
            "split or epoch, and take no part in the marks of our tables."
        ),
        head=[
            ColumnHead("Model"),
            ColumnHead("ours"),
            ColumnHead("published"),
            ColumnHead("source"),
        ],
        rows=entries,
        notes=table.notes.items(),
    )
