"""Sums of kernels over groups of features, and the grid of weights for inner folds."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product
from typing import NamedTuple

import torch
from torch import Tensor

from tactileforge.errors import ConfigError
from tactileforge_bench.fit.probes.ridge_regression import standardise

#: Steps along each edge of the simplex of weights.
STEPS = 4


class Kernels(NamedTuple):
    """Products of samples, one matrix a group.

    Attributes:
        gram: float64 (groups, n, n), of the training samples.
        cross: float64 (groups, m, n), of new samples with these.
    """

    gram: Tensor
    cross: Tensor

    def weighted(self, weights: Sequence[float]) -> tuple[Tensor, Tensor]:
        """The sums of the matrices with one weight a group."""
        factors = self.gram.new_tensor(weights)[:, None, None]
        return (self.gram * factors).sum(0), (self.cross * factors).sum(0)


def group_kernels(known: Tensor, asked: Tensor, sizes: Sequence[int] = ()) -> Kernels:
    """Products of standardised features, of each group alone, and none larger than another.

    A training sample's product with itself is 1 in the mean over the samples, so a group counts
    by its weight, however many features it has. One in which nothing varies stays 0.

    Args:
        known: (n, d), training samples.
        asked: (m, d), new samples.
        sizes: Numbers of features of the groups, side by side; none is one group.

    Raises:
        ConfigError: The sizes do not add up to d.
    """
    sizes = list(sizes) or [known.shape[1]]
    if sum(sizes) != known.shape[1]:
        raise ConfigError(f"groups of {sizes} features are not {known.shape[1]} features")
    known, asked = standardise(known, asked)
    grams, crosses = [], []
    for own, new in zip(torch.split(known, sizes, 1), torch.split(asked, sizes, 1), strict=True):
        # products in float32, which is fast; they are summed and decomposed in float64
        gram, cross = (own @ own.T).double(), (new @ own.T).double()
        scale = gram.diagonal().mean()
        # a group in which nothing varies has a kernel of zeros, and keeps it
        scale = torch.where(scale > 0, scale, 1.0)
        grams.append(gram / scale)
        crosses.append(cross / scale)
    return Kernels(torch.stack(grams), torch.stack(crosses))


def weight_grid(groups: int) -> list[tuple[float, ...]]:
    """Weights of groups, summing to 1, in steps of a quarter.

    The corners are single groups; a group that a task does not need gets weight 0.
    """
    steps = product(range(STEPS + 1), repeat=groups)
    return [tuple(count / STEPS for count in row) for row in steps if sum(row) == STEPS]
