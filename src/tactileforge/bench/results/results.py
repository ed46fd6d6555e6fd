"""Data classes of the results of a benchmark."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

FILE = "results.json"
FORMAT = 1


@dataclass(frozen=True, kw_only=True)
class ResultMetric:
    """A metric of a task.

    Attributes:
        name: Its name, e.g. ``rmse_sum_axes``.
        unit: Of its values; "" for a plain number.
        better: ``lower`` or ``higher``.
    """

    name: str
    unit: str
    better: str


@dataclass(frozen=True, kw_only=True)
class ResultTask:
    """One task of the suite.

    Attributes:
        name: The word users type.
        title: Its name in print; equal to a card's ``task`` where numbers are published for it.
        probe: What is trained on the features.
        data: What it is trained and tested on.
        split: How training, validation and test are told apart.
        metrics: All that is measured.
        main: The metric of the main table.
        selection: What the best epoch is chosen on, ``validation`` or ``test``.
        counted: Whether the release gate counts it.
    """

    name: str
    title: str
    probe: str
    data: str
    split: str
    metrics: list[ResultMetric]
    main: str
    selection: str
    counted: bool = True

    def metric(self, name: str = "") -> ResultMetric:
        """A metric by name, the main one by default."""
        return next(metric for metric in self.metrics if metric.name == (name or self.main))


@dataclass(frozen=True, kw_only=True)
class ResultModel:
    """One compared encoder.

    Attributes:
        name: The word users type.
        title: Its name in print.
        group: ``model``, or ``ablation`` of the first model of the same recipe.
        recipe: What it was trained with; "" if unknown.
        sha256: Of its weights; "" if it has none.
        facts: Parameters, frames, image size, steps and the like, by name.
    """

    name: str
    title: str
    group: str = "model"
    recipe: str = ""
    sha256: str = ""
    facts: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class Cell:
    """One trained and tested probe.

    Attributes:
        task: Name of a task.
        model: Name of a model.
        seed: Of the probe, or of the model where it was trained here.
        setting: Options of the probe; the first setting of a model in a task is the one of the
            main table.
        metrics: Values by name; NaN where there is no number.
        epoch: The best epoch; -1 where there are none.
        curve: Losses of the probe, by split.
        predictions: Path of what it predicted, from the folder of the results; "" if not kept.
    """

    task: str
    model: str
    seed: int
    metrics: dict[str, float]
    setting: dict[str, Any] = field(default_factory=dict)
    epoch: int = -1
    curve: dict[str, list[float]] = field(default_factory=dict)
    predictions: str = ""


@dataclass(frozen=True, kw_only=True)
class LossCurve:
    """Loss curve of one objective of a model pretrained for the benchmark.

    Attributes:
        model: Name of a model.
        objective: Its name.
        step: Optimiser steps.
        train: Training loss at each step; NaN where it was not logged.
        validation: The same in validation; empty if there was none.
    """

    model: str
    objective: str
    step: list[float]
    train: list[float]
    validation: list[float] = field(default_factory=list)


@dataclass(frozen=True, kw_only=True)
class NotRun:
    """A task, model or cell that was not run, with the reason.

    Attributes:
        reason: Why.
        fix: What to do about it; "" if nothing helps.
        task: Name of the task; "" for all tasks of the model.
        model: Name of the model; "" for all models of the task.
    """

    reason: str
    fix: str = ""
    task: str = ""
    model: str = ""

    def covers(self, task: str, model: str) -> bool:
        """Whether it applies to the given task and model."""
        return self.task in ("", task) and self.model in ("", model)


@dataclass(frozen=True, kw_only=True)
class Results:
    """All results of a benchmark.

    Attributes:
        suite: Its name.
        versions: Of the packages.
        settings: Seeds, epochs and the like, by name.
        tasks: Columns of the main table.
        models: Rows of the tables; also those of which all that is known is that they did not run.
        cells: What was measured.
        training: Loss curves of the models that were trained for the bench.
        not_run: What was not run, and why.
    """

    suite: str
    versions: dict[str, Any]
    settings: dict[str, Any]
    tasks: list[ResultTask]
    models: list[ResultModel]
    cells: list[Cell]
    training: list[LossCurve]
    not_run: list[NotRun]
