"""R2 of a whole split, from sums over its batches; see `contracts.Scored`."""

from __future__ import annotations

#: Smallest variance for which R2 is defined.
_LEAST = 1e-12


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
