"""Frames with a measured force, in blocks of time, to judge predictions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray


@dataclass
class Frames:
    """Frames with a measured force and all inputs, in blocks of time.

    Attributes:
        force: Measured force, float64 (N,), newton.
        fold: Number of the fold of each frame, int64 (N,).
        inputs: Inputs by name, float64 (N,) each.
        blocks: Numbers of the folds, int64 (K,).
    """

    force: NDArray[np.float64]
    fold: NDArray[np.int64]
    inputs: Mapping[str, NDArray[np.float64]] = field(default_factory=dict)
    blocks: NDArray[np.int64] = field(init=False)

    def __post_init__(self) -> None:
        self.blocks = np.unique(self.fold)

    def columns(self, names: Sequence[str]) -> NDArray[np.float64]:
        """Inputs side by side, float64 (N, n)."""
        return np.stack([self.inputs[name] for name in names], 1)

    def rmse(self, predicted: NDArray[np.float64]) -> float:
        """Root mean square error of predictions (N,), N."""
        return short(float(np.sqrt(self._losses(predicted).sum())))

    def r2(self, predicted: NDArray[np.float64]) -> float:
        """Share of the variance explained by predictions (N,)."""
        return short(1 - float(self._losses(predicted).sum()) / float(np.var(self.force)))

    def better(
        self, predicted: NDArray[np.float64], simpler: NDArray[np.float64], tie: float
    ) -> bool:
        """Whether predictions win, by more than a tie and the standard error over blocks.

        Args:
            predicted: Predictions, float64 (N,), newton.
            simpler: Predictions to beat, float64 (N,), newton.
            tie: Factor of their error within which the two are level, 0 to 1.
        """
        ours, theirs = self._losses(predicted), self._losses(simpler)
        gains = theirs - ours
        # standard error of a sum of n gains: sqrt(n) times the deviation of one
        noise = float(np.std(gains, ddof=1) * len(gains) ** 0.5)
        return bool(ours.sum() < tie**2 * theirs.sum() and gains.sum() > noise)

    def _losses(self, predicted: NDArray[np.float64]) -> NDArray[np.float64]:
        """Squared errors summed over each block, over the number of all frames, float64 (K,)."""
        squares = (predicted - self.force) ** 2
        return np.array([squares[self.fold == k].sum() for k in self.blocks]) / len(squares)


def short(value: float) -> float:
    """Rounds to seven significant digits."""
    return float(f"{value:.7g}")
