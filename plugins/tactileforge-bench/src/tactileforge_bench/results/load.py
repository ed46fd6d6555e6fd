"""Loads ``results.json`` strictly."""

from __future__ import annotations

import json
import math
from collections import Counter
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from tactileforge.errors import DataError, DataNotFoundError, unknown
from tactileforge.plugins import strict
from tactileforge_bench.results.results import (
    FILE,
    FORMAT,
    Cell,
    LossCurve,
    NotRun,
    ResultMetric,
    ResultModel,
    Results,
    ResultTask,
)

_LISTS = ("tasks", "models", "cells", "training", "not_run")
_OPTIONAL = ("training", "not_run")
_CHOICES = {
    "better": ("lower", "higher"),
    "selection": ("validation", "test"),
    "group": ("model", "ablation"),
}


def read_results(folder: Path) -> Results:
    """Reads ``results.json`` of a benchmark.

    Raises:
        DataNotFoundError: There is none in the folder.
        DataError: It is not JSON, of another format, or names what it does not hold.
        ConfigError: A key is missing, unknown or of another type; the message names it.
    """
    path = folder / FILE
    if not path.is_file():
        raise DataNotFoundError(f"{folder}: no {FILE} there; give the folder of a bench")
    try:
        content = strict.mapping(str(path), json.loads(path.read_text("utf-8")))
    except ValueError as error:
        raise DataError(f"{path}: not JSON ({error}); run the bench again") from error
    if content.pop("format", None) != FORMAT:
        raise DataError(
            f"{path}: 'format' is not {FORMAT}; use the version of tactileforge that wrote it"
        )
    results = _build(path, content)
    _check(path, results)
    return results


def read_cell(where: str, content: Any) -> Cell:
    """One cell, from plain data.

    Args:
        where: Place of the cell, for messages.
        content: Plain data, as in ``results.json``.

    Raises:
        DataError: A number is invalid.
        ConfigError: A key is missing, unknown or of another type.
    """
    cell = _row(where, "cells", content)
    assert isinstance(cell, Cell)
    return cell


def _build(path: Path, content: dict[str, Any]) -> Results:
    for key in _LISTS:
        value = content.get(key, [] if key in _OPTIONAL else None)
        if not isinstance(value, list):
            raise DataError(f"{path}: {key!r} is missing, or is not a list")
        content[key] = [_row(f"{path}, {key}[{i}]", key, row) for i, row in enumerate(value)]
    # a model that could not even be opened has a row without numbers, too
    known = {model.name for model in content["models"]}
    absent = dict.fromkeys(
        skipped.model for skipped in content["not_run"] if skipped.model not in {"", *known}
    )
    content["models"] += [ResultModel(name=name, title=name) for name in absent]
    return strict.build(Results, str(path), content)


def _row(where: str, key: str, content: Any) -> Any:
    """Builds one entry of a list; null means the default, as for ``epoch`` of a closed form."""
    row = {
        name: value for name, value in strict.mapping(where, content).items() if value is not None
    }
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
    if key == "cells" and isinstance(row.get("curve"), Mapping):
        row["curve"] = {
            name: _numbers(f"{where}: curve.{name}", values)
            for name, values in row["curve"].items()
        }
    if key == "training":
        for name in ("step", "train", "validation"):
            if name in row:
                row[name] = _numbers(f"{where}: {name}", row[name])
    kinds: dict[str, type[Any]] = {
        "tasks": ResultTask,
        "metrics": ResultMetric,
        "models": ResultModel,
        "cells": Cell,
        "training": LossCurve,
        "not_run": NotRun,
    }
    return strict.build(kinds[key], where, row)


def _numbers(where: str, values: Any) -> Any:
    """Numbers of a list as floats; anything else is left to the type check."""
    if not isinstance(values, list):
        return values
    return [_number(where, value) for value in values]


def _number(where: str, value: Any) -> float:
    # written for NaN, which JSON does not have
    if value is None:
        return math.nan
    # bool is an int in Python
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise DataError(f"{where} is {value!r}, not a number")
    return float(value)


def _check(path: Path, results: Results) -> None:
    """Validates the rules beyond the types."""
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
    for i, curve in enumerate(results.training):
        _known(f"{path}, training[{i}]: model", curve.model, models)
        if len(curve.train) != len(curve.step) or len(curve.validation) not in (0, len(curve.step)):
            raise DataError(
                f"{path}, training[{i}]: train and validation need one value for each step"
            )


def _known(what: str, name: str, names: Iterable[str]) -> None:
    if name not in names:
        raise DataError(unknown(what, name, names))


def _once(what: str, names: Iterable[str]) -> None:
    for name, count in Counter(names).items():
        if count > 1:
            raise DataError(f"{what} {name!r} appears {count} times; keep one")
