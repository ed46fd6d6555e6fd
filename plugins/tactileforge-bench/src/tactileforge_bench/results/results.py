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
        unit: Unit of its values; "" for a plain number.
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
        title: Name in print; equal to a card's ``task`` where numbers are published for it.
        probe: Probe trained on the features.
        data: Data of training and test.
        split: Separation of training, validation and test.
        metrics: All that is measured.
        main: The metric of the main table.
        selection: Clips for choosing the best epoch, ``validation`` or ``test``.
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
        recipe: Recipe of its training; "" if unknown.
        sha256: Hash of its weights; "" if it has none.
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
        seed: Seed of the probe, or of the model where it was trained here.
        setting: Options of the probe; the first setting of a model in a task is the one of the
            main table.
        metrics: Values by name; NaN where there is no number.
        epoch: The best epoch; -1 where there are none.
        curve: Losses of the probe, by split.
        predictions: Path of its predictions, from the folder of the results; "" if not kept.
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
        objective: Name of the objective.
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
    """A skipped task, model or cell, with the reason.

    Attributes:
        reason: Reason for skipping it.
        fix: Remedy; "" if nothing helps.
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
        suite: Name of the suite.
        versions: Versions of the packages, by name.
        settings: Seeds, epochs and the like, by name.
        tasks: Columns of the main table.
        models: Rows of the tables, including models of which no task was run.
        cells: Trained and tested probes.
        training: Loss curves of the models that were trained for the bench.
        not_run: Skipped tasks, models and cells, with reasons.
    """

    suite: str
    versions: dict[str, Any]
    settings: dict[str, Any]
    tasks: list[ResultTask]
    models: list[ResultModel]
    cells: list[Cell]
    training: list[LossCurve]
    not_run: list[NotRun]
