"""The logged values of a run, also of one that was resumed."""

from __future__ import annotations

import csv
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray


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
        """Means of at most ``count`` neighbourhoods of points."""
        if len(self.steps) <= count:
            return self
        parts = np.array_split(np.arange(len(self.steps)), count)
        steps = np.array([self.steps[part[-1]] for part in parts])
        return Curve(steps, np.array([self.values[part].mean() for part in parts]))


def read_metrics(folder: Path) -> dict[str, Curve]:
    """Reads ``metrics/version_*/metrics.csv`` of a run.

    A resumed run starts a new file. What an earlier file says of steps that a later one logs again
    was lost with the process that wrote it, so the later file wins from its first step on.

    Args:
        folder: Folder of the run.

    Returns:
        Curves by name (``train/pixel``, ``val/pixel``, ``weight/pixel``, ``lr``, ...).
    """
    kept: list[tuple[int, dict[str, str]]] = []
    for path in sorted(folder.glob("metrics/version_*/metrics.csv"), key=_version):
        with path.open(newline="") as file:
            whole = (row for row in csv.DictReader(file) if None not in row.values())
            rows = [
                (int(row["step"]), row) for row in whole
            ]  # a killed process may cut its last row
        if rows:
            first = min(step for step, _ in rows)
            kept = [(step, row) for step, row in kept if step < first] + rows
    points: dict[str, dict[int, float]] = {}
    for step, row in kept:
        for key, value in row.items():
            if value and key not in ("step", "epoch"):
                points.setdefault(key, {})[step] = float(value)
    return {key: _curve(values) for key, values in sorted(points.items())}


def _version(path: Path) -> int:
    return int(path.parent.name.removeprefix("version_"))


def _curve(points: dict[int, float]) -> Curve:
    steps = np.array(sorted(points), np.int64)
    return Curve(steps, np.array([points[step] for step in steps.tolist()]))


def weighed(values: Curve, weights: Curve) -> Curve:
    """Values times weights, at the steps at which both were logged."""
    steps, at, of = np.intersect1d(values.steps, weights.steps, return_indices=True)
    return Curve(steps, values.values[at] * weights.values[of])
