"""Scores over the seeds of a benchmark."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from tactileforge_bench.results.intervals import Interval, mean_interval
from tactileforge_bench.results.results import Cell, NotRun, ResultModel, Results, ResultTask

_NO_RESULT = "No result yet: the bench has not come to it. Run the same command again."


@dataclass(frozen=True)
class SeedScores:
    """The cells of one task, model and setting, by seed.

    Attributes:
        task: The task.
        model: The model.
        cells: In order of their seeds; at least one.
    """

    task: ResultTask
    model: ResultModel
    cells: tuple[Cell, ...]

    @property
    def setting(self) -> Mapping[str, Any]:
        """Options of the probe."""
        return self.cells[0].setting

    def interval(self, metric: str = "") -> Interval | None:
        """Mean and interval over the seeds with a finite number; None without any.

        Args:
            metric: Name of the metric; the main one of the task by default.
        """
        values = [cell.metrics.get(metric or self.task.main, math.nan) for cell in self.cells]
        finite = [value for value in values if math.isfinite(value)]
        return mean_interval(finite) if finite else None


#: By task and model; the first is that of the main table, further ones have other settings.
Scores = dict[tuple[str, str], list[SeedScores]]


def collect_scores(results: Results) -> Scores:
    """Groups the cells by task, model and setting."""
    tasks = {task.name: task for task in results.tasks}
    models = {model.name: model for model in results.models}
    parts: dict[tuple[str, str], dict[str, list[Cell]]] = {}
    for cell in results.cells:
        settings = parts.setdefault((cell.task, cell.model), {})
        # as text: a dict is not a key of another
        settings.setdefault(json.dumps(cell.setting, sort_keys=True), []).append(cell)
    return {
        (task, model): [
            SeedScores(tasks[task], models[model], tuple(sorted(cells, key=lambda cell: cell.seed)))
            for cells in settings.values()
        ]
        for (task, model), settings in parts.items()
    }


def main_score(all_scores: Scores, task: ResultTask, model: ResultModel) -> SeedScores | None:
    """The score of the main setting."""
    return next(iter(all_scores.get((task.name, model.name), [])), None)


def edge_rates(results: Results, all_scores: Scores) -> list[str]:
    """Hints, one per task: the best of several learning rates is the smallest or the largest."""
    lines = []
    for task in results.tasks:
        models = [all_scores.get((task.name, model.name), []) for model in results.models]
        # those of a model, the best first
        rates = [[one.setting["lr"] for one in scores if "lr" in one.setting] for scores in models]
        tried = sorted({rate for row in rates for rate in row})
        edges = {row[0] for row in rates if len(row) > 1 and row[0] in (tried[0], tried[-1])}
        for rate in sorted(edges):
            beyond = rate / 4 if rate == tried[0] else rate * 4
            grid = ",".join(f"{one:g}" for one in sorted({*tried, beyond}))
            lines.append(
                f"{task.title}: the best learning rate, {rate:g}, is at the edge of those tried; "
                f"a better one may lie beyond: task=[{task.name}] probe.lr=[{grid}]"
            )
    return lines


def words(results: Results, task: str, model: str) -> list[str]:
    """Reasons, with fixes, for a cell skipped in whole or in part."""
    return [sentences(skipped) for skipped in results.not_run if skipped.covers(task, model)]


def sentences(skipped: NotRun) -> str:
    """Reason and fix, each as a sentence; a path that one starts with stays as it is."""
    written = []
    for part in (skipped.reason, skipped.fix):
        if text := part.strip().rstrip("."):
            # a path, or a key to be typed, is not capitalised
            first = text.partition(" ")[0]
            is_typed = first.endswith(":") or "=" in first
            written.append(text if is_typed else text[0].upper() + text[1:])
    return " ".join(f"{text}." for text in written)


def missing(results: Results, task: str, model: str) -> list[str]:
    """Reasons for a cell without result, never empty."""
    return words(results, task, model) or [_NO_RESULT]


def full_model(results: Results, ablation: ResultModel) -> ResultModel | None:
    """The full model of an ablation: the first of the same recipe."""
    same = (m for m in results.models if m.group == "model" and m.recipe == ablation.recipe)
    return next(same, None)


def titles(results: Results) -> dict[str, str]:
    """Display title of each model; with its name where two models share a title."""
    every = [model.title for model in results.models]
    return {
        model.name: model.title
        if every.count(model.title) == 1
        else f"{model.title} ({model.name})"
        for model in results.models
    }
