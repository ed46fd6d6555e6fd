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
#: Standard errors below which a lead of the joined groups is taken for chance, see
#: `shrunk_weights`.
CHANCE = 1.25
#: Folds at most over which that lead is measured.
_FOLDS = 10


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


def shrunk_weights(errors: Tensor, grid: Sequence[tuple[float, ...]]) -> tuple[float, ...]:
    """Weights of the groups, as far from the first group alone as what they win is no chance.

    The weights of `level_weights` are drawn toward the first group by the share
    ``(CHANCE * standard error / lead)**2`` of the lead that they have over it, and reach it where
    that is 1 or there is no lead. The lead is over units that had no say in these weights: they
    are chosen anew without each fold of units, since the best of many candidates looks better than
    it is where it was chosen. So groups that do not help cost next to nothing.
    Source: shrinkage by the positive part, James and Stein (1961) and Baranchik (1964); the rule
    and its size were chosen on suite=real (docs/reports/findings.md).

    Args:
        errors: float64 (candidates, units), errors on each unit that is left out.
        grid: Candidate weights, with the first group alone.
    """
    units = errors.shape[1]
    alone = (1.0, *[0.0] * (len(grid[0]) - 1))
    lead = errors[grid.index(alone)].clone()
    for fold in range(min(units, _FOLDS)):
        out = torch.arange(units) % _FOLDS == fold
        lead[out] -= errors[level_weights(errors[:, ~out], grid), out]
    total, chance = float(lead.sum()), CHANCE * float(lead.std(correction=1)) * units**0.5
    if not total > chance:
        return alone
    share = (chance / total) ** 2
    joined = grid[level_weights(errors, grid)]
    return tuple(share * a + (1 - share) * b for a, b in zip(alone, joined, strict=True))


def level_weights(errors: Tensor, grid: Sequence[tuple[float, ...]]) -> int:
    """Place of the candidate with most of the first group that is level with the best one.

    Level is within one standard error of the paired difference over the units; of several the
    best is taken. Of a single unit there is no such error, and the best candidate is taken.
    Source: the rule of one standard error, Breiman, Friedman, Olshen and Stone (1984), chapter 3.

    Args:
        errors: float64 (candidates, units), see `shrunk_weights`.
        grid: Candidate weights.
    """
    totals = errors.sum(1)
    behind = errors - errors[totals.argmin()]
    units = errors.shape[1]
    chance = behind.std(1, correction=1) * units**0.5 if units > 1 else torch.zeros_like(totals)
    level = [place for place, far in enumerate((behind.sum(1) <= chance).tolist()) if far]
    return max(level, key=lambda place: (grid[place][0], -float(totals[place])))
