"""Linear layers under a penalty, fitted by L-BFGS until they have converged."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import nullcontext
from typing import NamedTuple

import torch
from torch import Tensor

from tactileforge.plugins import one_thread

#: Iterations of L-BFGS at most.
_ITERATIONS = 200
#: Multiplications of a product that one thread computes.
_SMALL = 1 << 24


class Axes(NamedTuple):
    """Singular vectors of the samples (n, k) and features (k, width), and the values (k,)."""

    left: Tensor
    lengths: Tensor
    right: Tensor


def axes_of(features: Tensor) -> Axes:
    """Singular value decomposition of centred features, float64 (n, width)."""
    return Axes(*torch.linalg.svd(features, full_matrices=False))


def fit_layer(
    axes: Axes,
    error: Callable[[Tensor], Tensor],
    penalty: float,
    start: Tensor,
    tolerance: float = 1e-6,
) -> Tensor:
    """Minimises an error plus half the penalty times the squared weights.

    Args:
        axes: Decomposition of the training samples.
        error: Convex function of the outputs (n, outputs); a mean over the samples.
        penalty: Penalty on the squared weights; the offset is not penalised.
        start: Weights and offset to start from, float64 (width + 1, outputs).
        tolerance: Largest component of the gradient at which it has converged.

    Returns:
        Weights of the features, and the offset, float64 (width + 1, outputs).
    """
    # along these axes, so scaled, the curvature of the objective is near 1: few iterations
    scale = (axes.lengths**2 / len(axes.left) + penalty).rsqrt()
    ones = axes.left.new_ones(len(axes.left), 1)
    rows = torch.cat([axes.left * (axes.lengths * scale), ones], 1)
    shrink = penalty * scale[:, None] ** 2

    def loss(weight: Tensor) -> Tensor:
        return error(rows @ weight) + (shrink * weight[:-1].square()).sum() / 2

    first = torch.cat([axes.right @ start[:-1] / scale[:, None], start[-1:]])
    # threads of small products wait for each other, four times as long on a busy machine
    with one_thread() if rows.numel() * start.shape[1] <= _SMALL else nullcontext():
        weights = _minimise(loss, first, tolerance)
    return torch.cat([axes.right.T @ (scale[:, None] * weights[:-1]), weights[-1:]])


def _minimise(loss: Callable[[Tensor], Tensor], start: Tensor, tolerance: float) -> Tensor:
    weight = start.clone().requires_grad_()
    optimiser = torch.optim.LBFGS(
        [weight],
        max_iter=_ITERATIONS,
        tolerance_grad=tolerance,
        # far below torch's default (1e-9): the gradient's tolerance ends the fit
        tolerance_change=1e-12,
        # without a search torch takes steps of a fixed length
        line_search_fn="strong_wolfe",
    )

    def closure() -> Tensor:
        optimiser.zero_grad()
        value = loss(weight)
        value.backward()  # type: ignore[no-untyped-call]
        return value

    optimiser.step(closure)  # type: ignore[no-untyped-call]
    return weight.detach()
