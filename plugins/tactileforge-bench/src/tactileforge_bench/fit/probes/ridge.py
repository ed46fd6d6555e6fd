"""The probe ``ridge``: ridge regression in closed form, its penalty chosen by inner folds."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

import torch
from torch import Tensor
from torch.nn import functional as F

from tactileforge_bench.fit.probes import ridge_regression
from tactileforge_bench.fit.probes.base import Probe, Values, class_scores
from tactileforge_bench.fit.probes.group_weights import Kernels, group_kernels, weight_grid
from tactileforge_bench.tasks.targets import TargetPart


class Ridge(Probe):
    """Ridge regression on standardised features, deterministic; its penalty is chosen.

    The penalty is that of the best predictions of training samples whose group is left out, in
    closed form: of each column alone where it is a number, of the classes together by balanced
    accuracy. Classes are regressed on as columns that are 1 / share where they are meant and 0
    elsewhere, so that each class counts the same; the largest wins.

    Of features in several groups (the reading ``groups``) the kernels are added, with weights on a
    grid of the simplex, chosen by the same predictions: see `choose_weights`. A group that a task
    does not need can have weight 0; equal weights are no default.
    Source: a sum of kernels, as in Bach, Lanckriet and Jordan (2004), its weights by
    cross-validation.

    Args:
        width: Size of a token; not needed.
        parts: Parts of the target.
    """

    tap: ClassVar[str] = "pooled"
    readings: ClassVar[tuple[str, ...]] = ("pooled", "summary", "patches", "groups")
    trained: ClassVar[bool] = False

    def solve(
        self,
        known: Tensor,
        truth: Values,
        groups: Sequence[str],
        asked: Tensor,
        sizes: Sequence[int] = (),
    ) -> tuple[Values, Values]:
        """Leave-group-out predictions of the training samples, and predictions of new ones.

        Args:
            known: (n, d), features of the training samples.
            truth: (n, columns), class indices or normalised vectors.
            groups: n names; samples of one name are left out together.
            asked: (m, d).
            sizes: Numbers of features of the groups of features that are weighed, side by side;
                none is one group.
        """
        kernels = group_kernels(known, asked, sizes)
        solved = {
            name: self.solve_part(part, kernels, truth[name], groups)
            for name, part in self.parts.items()
        }
        inner, outer = ({name: pair[i] for name, pair in solved.items()} for i in range(2))
        return inner, outer

    def solve_part(
        self, part: TargetPart, kernels: Kernels, truth: Tensor, groups: Sequence[str]
    ) -> tuple[Tensor, Tensor]:
        """Predictions of one part; see `solve`.

        Args:
            part: Part of the target.
            kernels: Products of the samples.
            truth: (n, columns).
            groups: n names; samples of one name are left out together, as in `solve`.
        """
        places = places_of(groups)
        weights = choose_weights(part, kernels, truth, places)
        gram, cross = kernels.weighted(weights)
        fit = ridge_regression.fit_ridge(gram, _coded(part, truth))
        # every penalty at once: the decomposition is the cost, and is shared
        tried = fit.left_out(fit.penalties, places)
        best = _best(part, tried, truth)
        used = sorted(set(best.tolist()))
        far = [cross @ fit.dual(fit.penalties[i]) + fit.mean for i in used]
        where = torch.tensor([used.index(i) for i in best.tolist()])
        inner, outer = _chosen(tried, best), _chosen(torch.stack(far), where)
        return _decoded(part, inner), _decoded(part, outer)


#: Share of the squared errors that is rounding.
_ROUNDING = 1e-6


def choose_weights(
    part: TargetPart, kernels: Kernels, truth: Tensor, groups: Sequence[Tensor]
) -> tuple[float, ...]:
    """Weights of the groups of features by leave-group-out predictions.

    Of the weights that predict as well as the best ones, within one standard error of the
    difference, those with the most of the first group (what a model was trained for); of several
    the ones that predict best. Features that only say more on the training side, such as the light
    of its sensor, so need a lead that is no chance. Which rule was chosen on suite=real
    (docs/reports/gate.md, groups of features).

    The compared value is the sum, over the columns of the regression, of the squared error in
    shares of the variance, each at its best penalty; of classes all columns have one penalty.
    Source: the rule of one standard error, Breiman, Friedman, Olshen and Stone (1984), chapter 3;
    here of paired differences over what is left out together.

    Args:
        part: Part of the target.
        kernels: Products of the samples.
        truth: (n, columns).
        groups: int64 places of the samples that are left out together.
    """
    grid = weight_grid(len(kernels.gram))
    if len(grid) == 1:
        return grid[0]
    coded = _coded(part, truth)
    variance = coded.var(0, correction=0).clamp(min=1e-12)
    rows = []
    for row in grid:
        fit = ridge_regression.fit_ridge(kernels.weighted(row)[0], coded)
        squares = (fit.left_out(fit.penalties, groups) - coded).square() / variance
        # classes share one penalty, so their columns are judged together
        squares = squares.sum(2, keepdim=True) if part.kind == "classes" else squares
        best = squares.mean(1).argmin(0)
        own = squares[best, :, torch.arange(len(best))].sum(0)
        rows.append(torch.stack([own[places].sum() for places in groups]))
    errors = torch.stack(rows)
    totals = errors.sum(1)
    behind = errors - errors[totals.argmin()]
    # rounding is chance, too: weights of a group in which nothing varies differ by nothing else
    chance = behind.std(1, correction=1) * len(groups) ** 0.5 + _ROUNDING * totals.min()
    level = [place for place, far in enumerate((behind.sum(1) <= chance).tolist()) if far]
    return grid[max(level, key=lambda place: (grid[place][0], -float(totals[place])))]


def places_of(groups: Sequence[str]) -> list[Tensor]:
    """int64 places of the samples of each group; where there is one group, of each sample."""
    by_group: dict[str, list[int]] = {}
    for place, name in enumerate(groups):
        by_group.setdefault(name, []).append(place)
    if len(by_group) == 1:  # none would be left to fit to
        return [torch.tensor([place]) for place in range(len(groups))]
    return [torch.tensor(places) for places in by_group.values()]


def _coded(part: TargetPart, truth: Tensor) -> Tensor:
    """Targets of the regression, (n, k)."""
    if part.kind != "classes":
        return truth
    # divided by its share, each class has the same weight in the squared error
    coded = F.one_hot(truth.long(), len(part.names)).double()
    return (coded / coded.mean(0).clamp(min=1 / len(truth))).flatten(1)


def _decoded(part: TargetPart, values: Tensor) -> Tensor:
    """Class indices, or normalised vectors, float32 (n, columns)."""
    if part.kind != "classes":
        return values.float()
    return class_scores(part, values).argmax(2).float()


def _best(part: TargetPart, tried: Tensor, truth: Tensor) -> Tensor:
    """Index of the best penalty of each column of the regression, int64 (k,).

    Args:
        part: Part of the target.
        tried: (penalties, n, k), predictions without the own group.
        truth: (n, columns).
    """
    if part.kind != "classes":
        return (tried - truth).square().mean(1).argmin(0)
    decoded = torch.stack([_decoded(part, values) for values in tried])
    score = balanced_scores(part, decoded, truth)
    # of equals the largest penalty
    best = len(score) - 1 - score.flip(0).argmax()
    return best.expand(tried.shape[2])


def balanced_scores(part: TargetPart, tried: Tensor, truth: Tensor) -> Tensor:
    """Scores proportional to the balanced accuracy, float64 (penalties,).

    Args:
        part: Part of the target.
        tried: (penalties, n, columns), class indices.
        truth: (n, columns).
    """
    return ((tried == truth).double() * class_weights(part, truth)[truth.long()]).sum((1, 2))


def class_weights(part: TargetPart, truth: Tensor) -> Tensor:
    """Weight of a sample of each class, for equal weight of all classes, float64 (classes,)."""
    count = torch.bincount(truth.flatten().long(), minlength=len(part.names))
    return 1 / count.clamp(min=1).double()


def _chosen(stacked: Tensor, best: Tensor) -> Tensor:
    """Gathers each column from its chosen row, (n, k)."""
    return stacked[best, :, torch.arange(len(best))].T
