"""R2 of a whole split, from sums over its batches; see `contracts.Scored`."""

from __future__ import annotations

#: Least variance that can be explained.
_LEAST = 1e-12


def r_squared(count: float, total: float, square: float, error: float) -> float | None:
    """Share of the variance that is explained.

    Args:
        count: Number of true values.
        total: Their sum.
        square: Sum of their squares.
        error: Sum of the squared errors of what was predicted.

    Returns:
        At most 1; None where there is nothing to explain.
    """
    if not count:
        return None
    variance = square / count - (total / count) ** 2  # E[y^2] - E[y]^2, in float64
    return 1 - error / count / variance if variance > _LEAST else None
