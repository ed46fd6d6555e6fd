"""What a bench leaves: ``results.json``, read strictly."""

from __future__ import annotations

import json
import math
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from tactileforge.errors import DataError, DataNotFoundError, unknown
from tactileforge.hub import strict

FILE = "results.json"
FORMAT = 1

_LISTS = ("tasks", "models", "cells", "training", "not_run")
_OPTIONAL = ("training", "not_run")
_CHOICES = {
    "better": ("lower", "higher"),
    "selection": ("validation", "test"),
    "group": ("model", "ablation"),
}


@dataclass(frozen=True, kw_only=True)
class Metric:
    """What is measured.

    Attributes:
        name: Its name, e.g. ``rmse_sum_axes``.
        unit: Of its values; "" for a plain number.
        better: ``lower`` or ``higher``.
    """

    name: str
    unit: str
    better: str


@dataclass(frozen=True, kw_only=True)
class Task:
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
    """

    name: str
    title: str
    probe: str
    data: str
    split: str
    metrics: list[Metric]
    main: str
    selection: str

    def metric(self, name: str = "") -> Metric:
        """A metric by name, the main one by default."""
        return next(metric for metric in self.metrics if metric.name == (name or self.main))


@dataclass(frozen=True, kw_only=True)
class Model:
    """One encoder that is compared.

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
    """One probe that was trained and tested.

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
    curve: dict[str, Any] = field(default_factory=dict)
    predictions: str = ""


@dataclass(frozen=True, kw_only=True)
class Training:
    """The loss of one objective of a model that was trained for the bench.

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
    """Something that was not run.

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
        """Whether it says so of that cell."""
        return self.task in ("", task) and self.model in ("", model)


@dataclass(frozen=True, kw_only=True)
class Results:
    """All of a bench.

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
    tasks: list[Task]
    models: list[Model]
    cells: list[Cell]
    training: list[Training]
    not_run: list[NotRun]


def read(folder: Path) -> Results:
    """Reads ``results.json`` of a bench.

    Raises:
        DataNotFoundError: There is none in the folder.
        DataError: It is no JSON, of another format, or names what it does not hold.
        ConfigError: A key is missing, unknown or of another type; the message names it.
    """
    path = folder / FILE
    if not path.is_file():
        raise DataNotFoundError(f"{folder}: no {FILE} there; give the folder of a bench")
    try:
        given = strict.mapping(str(path), json.loads(path.read_text("utf-8")))
    except ValueError as error:
        raise DataError(f"{path}: not JSON ({error}); run the bench again") from error
    if given.pop("format", None) != FORMAT:
        raise DataError(
            f"{path}: 'format' is not {FORMAT}; use the version of tactileforge that wrote it"
        )
    results = _build(path, given)
    _check(path, results)
    return results


def read_cell(where: str, given: Any) -> Cell:
    """One cell, from plain data.

    Args:
        where: Its place, for messages.
        given: As in ``results.json``.

    Raises:
        DataError: A number is none.
        ConfigError: A key is missing, unknown or of another type.
    """
    cell = _row(where, "cells", given)
    assert isinstance(cell, Cell)
    return cell


def _build(path: Path, given: dict[str, Any]) -> Results:
    for key in _LISTS:
        value = given.get(key, [] if key in _OPTIONAL else None)
        if not isinstance(value, list):
            raise DataError(f"{path}: {key!r} is missing, or is not a list")
        given[key] = [_row(f"{path}, {key}[{i}]", key, row) for i, row in enumerate(value)]
    known = {model.name for model in given["models"]}
    absent = dict.fromkeys(one.model for one in given["not_run"] if one.model not in {"", *known})
    given["models"] += [Model(name=name, title=name) for name in absent]
    return strict.build(Results, str(path), given)


def _row(where: str, key: str, given: Any) -> Any:
    """One entry of a list; null stands for a default, as ``epoch`` of a probe without epochs."""
    row = {name: value for name, value in strict.mapping(where, given).items() if value is not None}
    for name, allowed in _CHOICES.items():
        if name in row and row[name] not in allowed:
            raise DataError(f"{where}: {name} is {row[name]!r}, not one of {', '.join(allowed)}")
    if key == "tasks" and isinstance(row.get("metrics"), list):
        row["metrics"] = [
            _row(f"{where}, metrics[{i}]", "metrics", metric)
            for i, metric in enumerate(row["metrics"])
        ]
    if key == "cells" and isinstance(row.get("metrics"), Mapping):
        row["metrics"] = {
            name: _number(f"{where}: metrics.{name}", value)
            for name, value in row["metrics"].items()
        }
    if key == "training":
        for name in ("step", "train", "validation"):
            if isinstance(row.get(name), list):
                row[name] = [_number(f"{where}: {name}", value) for value in row[name]]
    kinds: dict[str, type[Any]] = {
        "tasks": Task,
        "metrics": Metric,
        "models": Model,
        "cells": Cell,
        "training": Training,
        "not_run": NotRun,
    }
    return strict.build(kinds[key], where, row)


def _number(where: str, value: Any) -> float:
    if value is None:
        return math.nan
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise DataError(f"{where} is {value!r}, not a number")
    return float(value)


def _check(path: Path, results: Results) -> None:
    """What types do not say."""
    tasks = {task.name: task for task in results.tasks}
    models = {model.name for model in results.models}
    _once(f"{path}: task", [task.name for task in results.tasks])
    _once(f"{path}: model", [model.name for model in results.models])
    for task in results.tasks:
        names = [metric.name for metric in task.metrics]
        _once(f"{path}: metric of task {task.name}", names)
        _known(f"{path}, task {task.name}: main metric", task.main, names)
    for i, cell in enumerate(results.cells):
        _known(f"{path}, cells[{i}]: task", cell.task, tasks)
        _known(f"{path}, cells[{i}]: model", cell.model, models)
        names = [metric.name for metric in tasks[cell.task].metrics]
        for name in cell.metrics:
            _known(f"{path}, cells[{i}]: metric", name, names)
    _once(
        f"{path}: cell",
        [
            f"{cell.task}, {cell.model}, seed {cell.seed}, {json.dumps(cell.setting)}"
            for cell in results.cells
        ],
    )
    for i, one in enumerate(results.training):
        _known(f"{path}, training[{i}]: model", one.model, models)
        if len(one.train) != len(one.step) or len(one.validation) not in (0, len(one.step)):
            raise DataError(
                f"{path}, training[{i}]: train and validation need one value for each step"
            )


def _known(what: str, name: str, names: Iterable[str]) -> None:
    if name not in names:
        raise DataError(unknown(what, name, names))


def _once(what: str, names: Iterable[str]) -> None:
    for name, count in Counter(names).items():
        if count > 1:
            raise DataError(f"{what} {name!r} is there {count} times; keep one")
