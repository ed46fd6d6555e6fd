"""The logged values of a run."""

from __future__ import annotations

import csv
import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

#: The file of all logged values, in the folder of a run.
METRICS = "metrics.csv"


@dataclass(frozen=True)
class Curve:
    """One logged value over the run.

    Attributes:
        steps: int64 (n,), strictly increasing, as in the CSV file.
        values: float64 (n,).
    """

    steps: NDArray[np.int64]
    values: NDArray[np.float64]

    def thinned(self, count: int = 400) -> Curve:
        """Averages neighbouring points down to at most ``count``."""
        if len(self.steps) <= count:
            return self
        parts = np.array_split(np.arange(len(self.steps)), count)
        steps = np.array([self.steps[part[-1]] for part in parts])
        return Curve(steps, np.array([self.values[part].mean() for part in parts]))


def read_metrics(folder: Path) -> dict[str, Curve]:
    """Reads ``metrics.csv`` of a run.

    Args:
        folder: Folder of the run.

    Returns:
        Curves by name (``train/pixel``, ``val/pixel``, ``weight/pixel``, ``lr``, ...).
    """
    points: dict[str, dict[int, float]] = {}
    for row in metric_rows(folder / METRICS):
        for key, value in row.items():
            if key not in ("step", "epoch") and value and math.isfinite(float(value)):
                points.setdefault(key, {})[int(row["step"])] = float(value)
    curves = {}
    for key, values in sorted(points.items()):
        # a resumed run may log a step again: the later row has won above
        steps = sorted(values)
        curves[key] = Curve(np.array(steps, np.int64), np.array([values[step] for step in steps]))
    return curves


def metric_rows(path: Path) -> list[dict[str, str]]:
    """Rows of a CSV file of metrics, without an incomplete last one; none if absent."""
    if not path.is_file():
        return []
    with path.open(newline="", encoding="utf-8") as file:
        # a killed run may leave half a line, and half a number is another number
        lines = [line for line in file if line.endswith("\n")]
    return [row for row in csv.DictReader(lines) if None not in row.values()]


def weighed(values: Curve, weights: Curve) -> Curve:
    """Values times weights, at the steps common to both."""
    steps, at, of = np.intersect1d(values.steps, weights.steps, return_indices=True)
    return Curve(steps, values.values[at] * weights.values[of])
