"""Scores of one axis of the force."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

#: Share of the deviation of a force below which its prediction has collapsed.
_COLLAPSED = 0.1


@dataclass(frozen=True)
class AxisScore:
    """One axis of one split.

    Attributes:
        mae: Mean absolute error, N.
        median: MAE of a constant guess, the median of the training clips, N.
        correlation: Correlation of measured and predicted force, -1 to 1; NaN if one of them does
            not vary.
        r2: Share of explained variance, at most 1; NaN if the force does not vary.
        measured: Standard deviation of the measured force, N.
        predicted: Standard deviation of the predicted force, N.
    """

    mae: float
    median: float
    correlation: float
    r2: float
    measured: float
    predicted: float

    @property
    def collapsed(self) -> bool:
        """Whether predictions are nearly constant although the force varies."""
        return self.predicted < _COLLAPSED * self.measured


def axis_score(
    measured: NDArray[np.float32], predicted: NDArray[np.float32], known: NDArray[np.float32]
) -> AxisScore:
    """Scores of predictions, N.

    Args:
        measured: Measured forces, float of any shape, N; NaN without a label.
        predicted: Predicted forces, same shape, N.
        known: Forces of the training clips, N; their median is the constant guess.
    """
    labelled = np.isfinite(measured)
    true, estimated = (part[labelled].astype(np.float64) for part in (measured, predicted))
    if not len(true):
        return AxisScore(*[float("nan")] * 6)
    # of all constants, the median has the least mean absolute error
    guess = np.median(known[np.isfinite(known)]) if np.isfinite(known).any() else np.median(true)
    moves = true.std() > 1e-6  # a correlation with a constant is noise of float32
    return AxisScore(
        mae=float(np.abs(estimated - true).mean()),
        median=float(np.abs(guess - true).mean()),
        correlation=float(np.corrcoef(true, estimated)[0, 1])
        if moves and estimated.std() > 1e-9
        else float("nan"),
        r2=1 - float(((estimated - true) ** 2).mean() / true.var()) if moves else float("nan"),
        measured=float(true.std()),
        predicted=float(estimated.std()),
    )
