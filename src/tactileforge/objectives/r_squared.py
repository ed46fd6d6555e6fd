"""R2 of a whole split, from sums over its batches; see `contracts.Scored`."""

from __future__ import annotations

import torch
from torch import Tensor

#: Smallest variance for which R2 is defined: that of equal values is rounding.
_LEAST = 1e-12


def moments(
    predicted: Tensor,
    true: Tensor,
    dims: tuple[int, ...] | None = None,
    valid: Tensor | None = None,
) -> Tensor:
    """Sums for `r_squared`: count, values, squares and squared errors, float64 (4, ...).

    Args:
        predicted: Predictions, of any shape.
        true: True values of the same shape.
        dims: Axes to sum over; None for all.
        valid: What counts, bool, broadcast to the shape; None for all. The rest may be NaN.
    """
    true, predicted = true.double(), predicted.detach().double()
    parts = torch.stack([torch.ones_like(true), true, true**2, (predicted - true) ** 2])
    if valid is not None:  # not by an index, whose size the host would wait for
        parts = torch.where(valid, parts, 0.0)
    return parts.sum(tuple(range(1, parts.ndim)) if dims is None else [d + 1 for d in dims])


def r_squared(count: float, total: float, square: float, error: float) -> float | None:
    """Share of explained variance.

    Args:
        count: Number of true values.
        total: Sum of the true values.
        square: Sum of their squares.
        error: Sum of the squared errors of the predictions.

    Returns:
        R2, at most 1; None without values or without variance.
    """
    if not count:
        return None
    variance = square / count - (total / count) ** 2  # E[y^2] - E[y]^2, in float64
    return 1 - error / count / variance if variance > _LEAST else None
