"""Writes the folder of a benchmark: ``results.json`` after every cell, and predictions."""

from __future__ import annotations

import csv
import hashlib
import io
import json
import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, replace
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from tactileforge.errors import TactileForgeError
from tactileforge.hub import card_names
from tactileforge.plugins import commit, new_part, write_text
from tactileforge_bench.results.load import read_cell
from tactileforge_bench.results.predictions import most_certain_wrong
from tactileforge_bench.results.results import (
    FILE,
    FORMAT,
    Cell,
    LossCurve,
    NotRun,
    ResultModel,
    Results,
    ResultTask,
)
from tactileforge_bench.tasks.targets import TargetPart

#: All cells that were ever measured, by task and model, with a hash of what they depend on: a
#: bench of other models, or one that is stopped before it comes to them, keeps them.
_MEASURED = "measured.json"
#: Pictures of wrong clips that are kept, and their height, pixels.
_SHOWN, _HEIGHT = 24, 96
_PACKAGES = ("tactileforge", "torch", "torchmetrics", "numpy")


class Writer:
    """Writer of results; keeps valid results of an interrupted benchmark.

    Args:
        folder: Folder of the results.
        suite: Name of the suites.
        settings: Settings of the bench.
        tasks: Tasks of the bench.

    Attributes:
        notes: Caveats of tasks, to read before their numbers, a line each.
    """

    def __init__(
        self, folder: Path, suite: str, settings: dict[str, Any], tasks: Sequence[ResultTask]
    ) -> None:
        self.folder = folder
        versions = {name: version(name) for name in _PACKAGES} | {"commit": commit()}
        self.results = Results(
            suite=suite,
            versions=versions,
            settings=settings,
            tasks=list(tasks),
            models=[],
            cells=[],
            training=[],
            not_run=[],
        )
        self.notes: list[str] = []
        self._measured = self._read()

    def _read(self) -> dict[str, tuple[str, list[Cell]]]:
        path = self.folder / _MEASURED
        try:
            rows = json.loads(path.read_text("utf-8"))
            return {
                what: (row["key"], [read_cell(str(path), cell) for cell in row["cells"]])
                for what, row in rows.items()
            }
        except (OSError, TactileForgeError, ValueError, TypeError, KeyError, AttributeError):
            return {}  # none yet, or of another format: everything is measured again

    def note(self, task: str, text: str) -> None:
        """Adds text to the split of a task, and to ``notes`` for the console."""
        self.notes.append(f"{task}: {text}")
        tasks = self.results.tasks
        # in place, as `Results` is frozen
        tasks[:] = [
            replace(row, split=f"{row.split}; {text}") if row.name == task else row for row in tasks
        ]

    def model(self, model: ResultModel) -> None:
        """Adds a row."""
        self.results.models.append(model)

    def training(self, curves: Sequence[LossCurve]) -> None:
        """Adds loss curves."""
        self.results.training.extend(curves)

    def kept(self, task: str, model: str, key: str) -> bool:
        """Keeps the stored cells of a task and model if they were measured under this key."""
        before, cells = self._measured.get(f"{task} {model}", ("", []))
        # a cell without its file of predictions cannot be drawn, so it is measured again
        there = all(
            cell.predictions == _predictions(cell) and (self.folder / cell.predictions).is_file()
            for cell in cells
        )
        if not cells or not there or before != key:
            return False
        self.results.cells.extend(cells)
        return True

    def cells(self, task: str, model: str, key: str, cells: Sequence[Cell]) -> None:
        """Adds the cells of a task and model, and writes the file."""
        self.results.cells.extend(cells)
        self._measured[f"{task} {model}"] = key, list(cells)
        self.write()

    def not_run(self, reason: str, task: str = "", model: str = "", fix: str = "") -> None:
        """Adds a skipped task, model or cell, and writes the file."""
        row = NotRun(reason=reason, fix=fix, task=task, model=model)
        if row not in self.results.not_run:
            self.results.not_run.append(row)
        self.write()

    def write(self) -> None:
        """Writes the file atomically."""
        plain = {"format": FORMAT} | asdict(self.results)
        # null is of all tasks, or of all models
        for row in plain["not_run"]:
            row |= {name: row[name] or None for name in ("task", "model")}
        write_text(self.folder / FILE, _text(plain))
        kept = {
            what: {"key": key, "cells": [asdict(cell) for cell in cells]}
            for what, (key, cells) in self._measured.items()
        }
        write_text(self.folder / _MEASURED, _text(kept))

    def predictions(
        self,
        cell: Cell,
        name: str,
        part: TargetPart,
        predicted: Any,
        truth: Any,
        units: Sequence[str],
        clips: Sequence[str],
        probability: Any = None,
        picture: Callable[[int], NDArray[np.uint8]] | None = None,
    ) -> Cell:
        """Stores predictions, classes also as a table; returns the cell with their path.

        Args:
            cell: Cell of the predictions.
            name: Name of the predicted part.
            part: Part of the target.
            predicted: (n, columns).
            truth: True values, (n, columns).
            units: Bootstrap unit of each clip.
            clips: Recording and last frame of each.
            probability: Probabilities of classes, (n, columns, classes); None without.
            picture: Gives the last frame of a clip, uint8 (H, W, 3), by its place; None keeps none.
        """
        path = self.folder / _predictions(cell)
        kind = np.int64 if part.kind == "classes" else np.float32
        names = "names" if part.kind == "classes" else "axes"
        arrays = {
            "truth": truth.numpy().astype(kind),
            "predicted": predicted.numpy().astype(kind),
            names: np.array(part.names),
            "units": np.array(units),
        }
        if part.kind == "classes" and truth.shape[1] == 1:
            arrays |= {key: arrays[key][:, 0] for key in ("truth", "predicted")}
            arrays["clips"] = np.array(clips)
            if probability is not None:
                arrays["probability"] = probability[:, 0].numpy().astype(np.float32)
            if picture is not None:
                arrays |= _pictures(arrays, picture)
            write_text(path.with_suffix(".csv"), _class_table(arrays))
        with new_part(path, path.suffix) as file:  # without the suffix, numpy adds its own
            np.savez_compressed(file, **arrays)
            file.replace(path)
        return replace(cell, predictions=_predictions(cell))


def _class_table(arrays: Mapping[str, NDArray[Any]]) -> str:
    """Truth, prediction and probabilities of each clip."""
    names, shares = arrays["names"], arrays.get("probability")
    head = ["clip", "truth", "predicted"]
    columns: list[Any] = [arrays["clips"]]
    columns += [names[arrays[key]] for key in ("truth", "predicted")]
    if shares is not None:
        head += ["probability", *(f"probability of {name}" for name in names)]
        said = shares[np.arange(len(shares)), arrays["predicted"]]
        columns += [[f"{value:.4f}" for value in column] for column in (said, *shares.T)]
    table = io.StringIO()
    writer = csv.writer(table, lineterminator="\n")
    writer.writerows([head, *zip(*columns, strict=True)])
    return table.getvalue()


def _pictures(
    arrays: Mapping[str, NDArray[Any]], picture: Callable[[int], NDArray[np.uint8]]
) -> dict[str, NDArray[Any]]:
    """Small pictures of the wrong clips, the most certain ones first, and their places."""
    truth, predicted = arrays["truth"], arrays["predicted"]
    places = most_certain_wrong(truth, predicted, arrays.get("probability"))[:_SHOWN]
    pictures = [Image.fromarray(picture(int(place))) for place in places]
    if not pictures:
        return {}
    size = (max(1, round(_HEIGHT * pictures[0].width / pictures[0].height)), _HEIGHT)
    return {"wrong": places, "pictures": np.stack([np.asarray(p.resize(size)) for p in pictures])}


def file_name(*words: str) -> str:
    """Words as one name of a file, without its ending; other words give another name.

    Plain words stay, and dots become ``_`` in names of the zoo and in numbers. All others get a
    hash too: cleaned, ``file:../a`` and ``file:a`` are the same.

    Example:
        >>> file_name("classes", "anytouch2.tiny", "0.001")
        'classes.anytouch2_tiny.0_001'
    """
    return ".".join(map(_file_word, words))


def _file_word(word: str) -> str:
    clean = re.sub(r"[^\w-]+", "_", word)
    # of anytouch2.tiny and anytouch2_tiny, or 0.1 and 0_1, the first takes the plain name
    stems = "|".join([r"\d+", *map(re.escape, card_names())])
    pair = re.fullmatch(rf"(?:{stems})([._])[A-Za-z0-9-]+", word)
    plain = pair[1] == "." if pair else clean == word
    return clean if plain else f"{clean}~{hashlib.sha256(word.encode()).hexdigest()[:8]}"


def _predictions(cell: Cell) -> str:
    """The path of the predictions of a cell, from the folder of the results."""
    setting = map(str, cell.setting.values())
    return f"predictions/{file_name(cell.task, cell.model, *setting, str(cell.seed))}.npz"


def _text(plain: Any) -> str:
    return json.dumps(_finite(plain), indent=1, allow_nan=False) + "\n"


def _finite(value: Any) -> Any:
    """NaN as null: JSON has none."""
    if isinstance(value, dict):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(item) for item in value]
    return None if isinstance(value, float) and math.isnan(value) else value
