"""Tables of measured numbers: models by tasks, and ablations."""

from __future__ import annotations

import math
from collections.abc import Sequence

from tactileforge_bench.output.grid import (
    ARROWS,
    DAGGER,
    ColumnHead,
    Notes,
    Table,
    TableEntry,
    Tone,
    decimals,
    plus_minus,
    ranks,
)
from tactileforge_bench.results.intervals import Interval, difference_interval
from tactileforge_bench.results.results import ResultMetric, ResultModel, Results, ResultTask
from tactileforge_bench.results.scores import (
    Scores,
    SeedScores,
    full_model,
    main_score,
    missing,
    sentences,
    titles,
    words,
)

_TEST = "The epoch was chosen on the test set: these numbers are optimistic."
MEAN = (
    "Mean over seeds ± half the width of its 95 % interval (Student's t); one seed has no interval."
)


class Columns:
    """Writes the columns of a table, and collects its footnotes."""

    def __init__(self, results: Results, all_scores: Scores) -> None:
        self.results = results
        self.all_scores = all_scores
        self.notes = Notes()

    def head(self, task: ResultTask) -> ColumnHead:
        """Title, main metric, and the better direction."""
        return metric_head(task.metric(), task.title)

    def score(self, task: ResultTask, model: ResultModel) -> SeedScores | None:
        """The score of the main setting."""
        return main_score(self.all_scores, task, model)

    def column(self, task: ResultTask, models: Sequence[ResultModel]) -> list[TableEntry]:
        """Scores of models, the best marked."""
        return self.column_of(task, [(model, self.score(task, model)) for model in models])

    def column_of(
        self, task: ResultTask, rows: Sequence[tuple[ResultModel, SeedScores | None]]
    ) -> list[TableEntry]:
        """Scores in one task, the best marked; words where there are none."""
        known = [score.interval() if score else None for _, score in rows]
        digits = digits_of(known)
        marks = ranks([row.mean if row else None for row in known], task.metric().better, digits)
        return [
            TableEntry(plus_minus(interval, digits), mark, self.marks(score))
            if score and interval
            else self.without(task, model, score)
            for (model, score), interval, mark in zip(rows, known, marks, strict=True)
        ]

    def marks(self, score: SeedScores, metric: str = "") -> tuple[str, ...]:
        """Footnotes of a score."""
        task = score.task
        reasons = words(self.results, task.name, score.model.name)
        numbers = score.interval(metric)
        lost = len(score.cells) - (len(numbers.values) if numbers else 0)
        if lost:
            reasons = [*reasons, f"{lost} of {len(score.cells)} seeds gave no finite number."]
        selection_note = (self.notes.own(DAGGER, _TEST),) if task.selection == "test" else ()
        return (*selection_note, *map(self.notes.letter, reasons))

    def without(
        self, task: ResultTask, model: ResultModel, score: SeedScores | None, metric: str = ""
    ) -> TableEntry:
        """An entry without a number, with its reason as a footnote."""
        if score:
            return TableEntry("no number", marks=self.marks(score, metric), tone="soft")
        reasons = missing(self.results, task.name, model.name)
        return TableEntry("not run", marks=tuple(map(self.notes.letter, reasons)), tone="soft")


def metric_head(metric: ResultMetric, title: str = "") -> ColumnHead:
    """The head of a column of one metric."""
    unit = f" ({metric.unit})" if metric.unit else ""
    below = f"{metric.name}{unit} {ARROWS[metric.better]}"
    return ColumnHead(title, below) if title else ColumnHead(below)


def digits_of(intervals: Sequence[Interval | None]) -> int:
    """Digits after the point for a column."""
    return decimals(interval.mean for interval in intervals if interval)


def main_models(results: Results) -> list[ResultModel]:
    """The rows of the main table: all but ablations."""
    return [model for model in results.models if model.group == "model"]


def main_table(results: Results, all_scores: Scores) -> Table | None:
    """Models by tasks, in the main metric of each; None where there is no model or no task."""
    models = main_models(results)
    if not models or not results.tasks:
        return None
    table, names = Columns(results, all_scores), titles(results)
    columns = [table.column(task, models) for task in results.tasks]
    # tasks that were not run at all have no column, so a footnote names them
    listed = {"", *(task.name for task in results.tasks)}
    others = [
        ("‡", f"Task {skipped.task} was not run. {sentences(skipped)}")
        for skipped in results.not_run
        if skipped.task not in listed
    ]
    return Table(
        name="main",
        title=f"Models compared: {results.suite}",
        caption=f"{MEAN} Best in bold, second best underlined, by the mean.",
        head=[ColumnHead("Model"), *map(table.head, results.tasks), ColumnHead("seeds")],
        rows=[
            [TableEntry(names[model.name]), *entries, TableEntry(_seeds(table, model))]
            for model, *entries in zip(models, *columns, strict=True)
        ],
        notes=[*table.notes.items(), *others],
    )


def _seeds(table: Columns, model: ResultModel) -> str:
    row = [table.score(task, model) for task in table.results.tasks]
    counts = sorted({len(score.cells) for score in row if score})
    return " to ".join(str(count) for count in dict.fromkeys((*counts[:1], *counts[-1:]))) or "none"


def ablation_table(results: Results, all_scores: Scores) -> Table | None:
    """Each ablation against its full model; None without ablations."""
    ablations = [model for model in results.models if model.group == "ablation"]
    if not ablations or not results.tasks:
        return None
    pairs = [(model, full_model(results, model)) for model in ablations]
    fulls = list({full.name: full for _, full in pairs if full}.values())
    # each full model above its ablations
    ordered: list[tuple[ResultModel, ResultModel | None]] = []
    for full in fulls:
        ordered += [(full, None), *(pair for pair in pairs if pair[1] == full)]
    ordered += [pair for pair in pairs if pair[1] is None]
    table, names = Columns(results, all_scores), titles(results)
    columns = [_ablation_column(table, task, ordered) for task in results.tasks]
    caption = (
        "After the mean the difference to the full model ± its 95 % interval (pooled variance, "
        "Student's t). ▼ worse and ▲ better, beyond that interval; ▽ worse and △ better, but "
        "within it, or with one seed each, which gives none."
    )
    return Table(
        name="ablations",
        title="Ablations",
        caption=caption,
        head=[ColumnHead("Model"), *map(table.head, results.tasks), ColumnHead("seeds")],
        rows=[
            [TableEntry(names[model.name]), *entries, TableEntry(_seeds(table, model))]
            for (model, _), *entries in zip(ordered, *columns, strict=True)
        ],
        notes=table.notes.items(),
    )


def _ablation_column(
    table: Columns, task: ResultTask, rows: Sequence[tuple[ResultModel, ResultModel | None]]
) -> list[TableEntry]:
    plain = [table.score(task, model) for model, _ in rows]
    digits = digits_of([score.interval() if score else None for score in plain])
    entries = []
    for (model, full), score in zip(rows, plain, strict=True):
        interval = score.interval() if score else None
        if score is None or interval is None:
            entries.append(table.without(task, model, score))
            continue
        value_text, marks = plus_minus(interval, digits), table.marks(score)
        base = table.score(task, full) if full else None
        against = base.interval() if base else None
        # a full model is compared with none
        if against is None:
            if model.group == "ablation":
                marks = (
                    *marks,
                    table.notes.letter("The full model has no number to compare with."),
                )
            entries.append(TableEntry(value_text, marks=marks))
            continue
        change = difference_interval(interval, against)
        sign, tone = comparison_mark(change, task.metric().better)
        value_text = plus_minus(Interval(interval.mean, math.nan, ()), digits)
        below = f"{plus_minus(change, digits, signed=True)} {sign}".rstrip()
        entries.append(TableEntry(value_text, marks=marks, tone=tone, below=below))
    return entries


def comparison_mark(change: Interval, better: str) -> tuple[str, Tone]:
    """The sign of a difference, and its tone; filled if it exceeds its interval."""
    if change.mean == 0:
        return "", ""
    worse = (change.mean > 0) == (better == "lower")
    if abs(change.mean) > change.half:  # false where there is no interval
        return ("▼", "bad") if worse else ("▲", "good")
    return ("▽" if worse else "△"), ""
