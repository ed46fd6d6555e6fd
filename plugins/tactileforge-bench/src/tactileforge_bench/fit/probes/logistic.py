"""The probe ``logistic``: logistic regression, its penalty chosen by inner folds."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import torch
from torch import Tensor
from torch.nn import functional as F

from tactileforge_bench.fit.probes import convex, ridge_regression
from tactileforge_bench.fit.probes.base import class_scores
from tactileforge_bench.fit.probes.group_weights import Kernels
from tactileforge_bench.fit.probes.ridge import (
    Ridge,
    balanced_scores,
    choose_weights,
    class_weights,
    places_of,
)
from tactileforge_bench.tasks.targets import TargetPart

#: Penalties that are tried, as shares of the mean square of the standardised features' length.
PENALTIES = tuple(10.0**-power for power in range(1, 6))
#: Inner folds at most.
_FOLDS = 4
#: Largest component of the gradient at which a fit has converged.
_CONVERGED = 1e-4


class Logistic(Ridge):
    """Multinomial logistic regression on standardised features by L-BFGS; numbers as `Ridge` does.

    Each class counts the same. Training groups are dealt to at most four inner folds; of five
    penalties that with the best balanced accuracy of the left out predictions is taken, the largest
    of equals. Samples of a single group are dealt one by one. Groups of features have the weights
    that `Ridge` chooses, in closed form. The problem is convex and nothing is
    drawn at random.

    Args:
        width: Size of a token; not needed.
        parts: Parts of the target.
    """

    def solve_part(
        self, part: TargetPart, kernels: Kernels, truth: Tensor, groups: Sequence[str]
    ) -> tuple[Tensor, Tensor]:
        """See `Ridge.solve_part`."""
        if part.kind != "classes":
            return super().solve_part(part, kernels, truth, groups)
        weights = choose_weights(part, kernels, truth, places_of(groups))
        known, asked = ridge_regression.coordinates(*kernels.weighted(weights))
        penalties = [share * float(known.square().sum(1).mean()) for share in PENALTIES]
        tried = truth.new_empty(len(penalties), *truth.shape)
        for left_out in inner_folds(places_of(groups)):
            # fitted to the other folds, at all penalties along one path
            rest = torch.ones(len(truth), dtype=torch.bool)
            rest[left_out] = False
            layers = _path(part, known[rest], truth[rest], penalties)
            for row, layer in zip(tried, layers, strict=True):
                row[left_out] = _decoded(part, known[left_out], layer)
        best = int(balanced_scores(part, tried, truth).argmax())  # of equals the largest penalty
        layer = _path(part, known, truth, penalties[: best + 1])[-1]
        return tried[best], _decoded(part, asked, layer)


def inner_folds(groups: Sequence[Tensor]) -> list[Tensor]:
    """Deals groups to folds: the largest first, each to the smallest fold so far.

    Args:
        groups: int64 places of the samples of each group.
    """
    dealt: list[list[Tensor]] = [[] for _ in range(min(_FOLDS, len(groups)))]
    for places in sorted(groups, key=len, reverse=True):
        min(dealt, key=lambda fold: sum(map(len, fold))).append(places)
    return [torch.cat(fold) for fold in dealt]


def _path(
    part: TargetPart, known: Tensor, truth: Tensor, penalties: Sequence[float]
) -> list[Tensor]:
    """The fitted layer at each penalty: weights and offset, for features as they are."""
    mean = known.mean(0)
    axes, error = convex.axes_of(known - mean), balanced_error(part, truth)
    weight = known.new_zeros(known.shape[1] + 1, part.outputs)
    layers = []
    for penalty in penalties:
        weight = convex.fit_layer(axes, error, penalty, weight, _CONVERGED)
        layers.append(torch.cat([weight[:-1], (weight[-1] - mean @ weight[:-1])[None]]))
    return layers


def balanced_error(part: TargetPart, truth: Tensor) -> Callable[[Tensor], Tensor]:
    """Cross-entropy of logits (n, outputs), with equal weight for each class.

    Args:
        part: Part of the target.
        truth: (n, columns), class indices.
    """
    classes, weight = truth.flatten().long(), class_weights(part, truth)
    return lambda out: F.cross_entropy(class_scores(part, out).flatten(0, 1), classes, weight)


def _decoded(part: TargetPart, features: Tensor, layer: Tensor) -> Tensor:
    return class_scores(part, features @ layer[:-1] + layer[-1]).argmax(2).float()
