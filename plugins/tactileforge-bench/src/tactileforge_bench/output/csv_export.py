"""Exports every number of a benchmark as CSV, one per row."""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Iterator, Sequence

from tactileforge_bench.output.published import PublishedScore
from tactileforge_bench.results.intervals import Interval
from tactileforge_bench.results.results import ResultMetric, ResultModel, Results, ResultTask
from tactileforge_bench.results.scores import Scores, SeedScores, missing, sentences, words

COLUMNS = (
    "task", "model", "group", "metric", "unit", "better", "setting", "selection",
    "mean", "low", "high", "seeds", "origin", "source", "note",
)  # fmt: skip


def long_form(results: Results, all_scores: Scores, rows: Sequence[PublishedScore]) -> str:
    """The results as CSV text, one number per row.

    ``origin`` is ``ours`` or ``published``. Where ``mean`` is empty, ``note`` says why.
    """
    file = io.StringIO()
    # the same bytes on every system: csv ends lines by \r\n
    writer = csv.DictWriter(file, COLUMNS, restval="", lineterminator="\n")
    writer.writeheader()
    for task in results.tasks:
        for model in results.models:
            writer.writerows(_ours(results, all_scores, task, model))
    listed = {task.name for task in results.tasks}
    for skipped in results.not_run:
        if skipped.task and skipped.task not in listed:
            note = f"not run: {sentences(skipped)}"
            writer.writerow(
                {"task": skipped.task, "model": skipped.model, "origin": "ours", "note": note}
            )
    for row in rows:
        writer.writerow(
            {
                "task": row.task,
                "model": row.model,
                "metric": row.metric,
                "unit": row.unit,
                "mean": row.value,
                "origin": "published",
                "source": row.source,
            }
        )
    return file.getvalue()


def _ours(
    results: Results, all_scores: Scores, task: ResultTask, model: ResultModel
) -> Iterator[dict[str, object]]:
    known = all_scores.get((task.name, model.name), [])
    about = " ".join(words(results, task.name, model.name))
    for score in known:
        for metric in task.metrics:
            yield _row(task, model, metric) | _numbers(score, score.interval(metric.name), about)
    if not known:
        why = " ".join(missing(results, task.name, model.name))
        yield _row(task, model, task.metric()) | {"seeds": 0, "note": f"not run: {why}"}


def _row(task: ResultTask, model: ResultModel, metric: ResultMetric) -> dict[str, object]:
    return {
        "task": task.name,
        "model": model.name,
        "group": model.group,
        "metric": metric.name,
        "unit": metric.unit,
        "better": metric.better,
        "selection": task.selection,
        "origin": "ours",
        "source": "results.json",
    }


def _numbers(score: SeedScores, interval: Interval | None, about: str) -> dict[str, object]:
    count = len(interval.values) if interval else 0
    row: dict[str, object] = {"setting": json.dumps(score.setting), "seeds": count}
    notes = [about] if about else []
    if count < len(score.cells):
        notes.append(f"{len(score.cells) - count} of {len(score.cells)} seeds gave no number")
    if interval:
        row["mean"] = interval.mean
        if math.isnan(interval.half):
            notes.append("one seed: no interval")
        else:
            row |= {"low": interval.mean - interval.half, "high": interval.mean + interval.half}
    return row | {"note": "; ".join(notes)}
