"""Tables of the tried settings, and of every metric of a task."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from tactileforge_bench.output.comparison_tables import MEAN, Columns, digits_of, metric_head
from tactileforge_bench.output.grid import (
    ColumnHead,
    Table,
    TableEntry,
    plus_minus,
)
from tactileforge_bench.results.results import ResultModel, Results, ResultTask
from tactileforge_bench.results.scores import (
    Scores,
    SeedScores,
    titles,
)


def settings_table(results: Results, all_scores: Scores) -> Table | None:
    """Models by settings; None where each has only one."""
    tried = {key: some for key, some in all_scores.items() if len(some) > 1}
    if not tried:
        return None
    table, names = Columns(results, all_scores), titles(results)
    tasks = [task for task in results.tasks if any(key[0] == task.name for key in tried)]
    rows: list[tuple[ResultModel, dict[str, Any]]] = []
    for model in results.models:
        for (_, name), some in tried.items():
            if name == model.name:
                rows += [
                    (model, dict(score.setting))
                    for score in some
                    # a setting that several tasks tried has one row
                    if (model, dict(score.setting)) not in rows
                ]
    columns = [_settings_column(table, task, rows) for task in tasks]
    # what all rows have in common is no reason for a difference between them
    settings = [setting for _, setting in rows]
    varied = {k for s in settings for k in s if any(other.get(k) != s[k] for other in settings)}
    return Table(
        name="settings",
        title="Settings of the probes",
        caption=(
            f"{MEAN} Best in bold, second best underlined, of the settings of one model. "
            "Test numbers: choose no setting by them."
        ),
        head=[ColumnHead("Model"), ColumnHead("setting"), *map(table.head, tasks)],
        rows=[
            [
                TableEntry(names[model.name]),
                TableEntry(
                    ", ".join(f"{key}={value}" for key, value in setting.items() if key in varied)
                    or "as published",
                    tone="text",
                ),
                *entries,
            ]
            for (model, setting), *entries in zip(rows, *columns, strict=True)
        ],
        notes=table.notes.items(),
    )


def _settings_column(
    table: Columns, task: ResultTask, rows: Sequence[tuple[ResultModel, dict[str, Any]]]
) -> list[TableEntry]:
    """One task; the best are marked model by model."""
    entries: list[TableEntry] = []
    for model in dict.fromkeys(model.name for model, _ in rows):
        scores = table.all_scores.get((task.name, model), [])
        settings = [(m, setting) for m, setting in rows if m.name == model]
        scored = [
            (m, next((s for s in scores if dict(s.setting) == setting), None))
            for m, setting in settings
        ]
        written = table.column_of(task, scored)
        for (_, score), entry in zip(scored, written, strict=True):
            if score is None and scores:
                entry = TableEntry("not tried", tone="soft")
            elif score is not None and score is scores[0]:
                note = table.notes.letter("The setting of the main table.")
                entry = TableEntry(entry.text, entry.rank, (*entry.marks, note), entry.tone)
            entries.append(entry)
    return entries


def details_table(results: Results, all_scores: Scores, task: ResultTask) -> Table | None:
    """Every metric of one task; None where there is no model."""
    if not results.models:
        return None
    table, names = Columns(results, all_scores), titles(results)
    scores = [table.score(task, model) for model in results.models]
    columns = []
    for metric in task.metrics:
        known = [score.interval(metric.name) if score else None for score in scores]
        digits = digits_of(known)
        columns.append(
            [
                TableEntry(plus_minus(interval, digits), marks=table.marks(score, metric.name))
                if score and interval
                else table.without(task, model, score, metric.name)
                for model, score, interval in zip(results.models, scores, known, strict=True)
            ]
        )
    return Table(
        name=f"details-{task.name}",
        title=task.title,
        caption=MEAN,
        head=[
            ColumnHead("Model"),
            *map(metric_head, task.metrics),
            ColumnHead("seeds"),
            ColumnHead("best epochs"),
        ],
        rows=[
            [TableEntry(names[model.name]), *entries, *_how(score)]
            for model, score, *entries in zip(results.models, scores, *columns, strict=True)
        ],
        notes=table.notes.items(),
    )


def _how(score: SeedScores | None) -> tuple[TableEntry, TableEntry]:
    if score is None:
        return TableEntry("none", tone="soft"), TableEntry("none", tone="soft")
    epochs = [str(cell.epoch) if cell.epoch >= 0 else "none" for cell in score.cells]
    return TableEntry(str(len(score.cells))), TableEntry(", ".join(epochs))
