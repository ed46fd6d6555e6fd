"""The probe ``ridge``: ridge regression in closed form, its penalty chosen by inner folds."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

import torch
from torch import Tensor
from torch.nn import functional as F

from tactileforge.bench.fit.probes import ridge_regression
from tactileforge.bench.fit.probes.base import Probe, Values, class_scores
from tactileforge.bench.tasks.targets import TargetPart


class Ridge(Probe):
    """Ridge regression on standardised features, deterministic; only the penalty is chosen.

    The penalty is that of the best predictions of training samples whose group is left out, in
    closed form: of each column alone where it is a number, of the classes together by balanced
    accuracy. Classes are regressed on as columns that are 1 / share where they are meant and 0
    elsewhere, so that each class counts the same; the largest wins.

    Args:
        width: Size of a token; not needed.
        parts: What is predicted.
    """

    tap: ClassVar[str] = "pooled"
    readings: ClassVar[tuple[str, ...]] = ("pooled", "summary", "patches")
    trained: ClassVar[bool] = False

    def solve(
        self, known: Tensor, truth: Values, groups: Sequence[str], asked: Tensor
    ) -> tuple[Values, Values]:
        """Leave-group-out predictions of the training samples, and predictions of new ones.

        Args:
            known: (n, d), features of the training samples.
            truth: (n, columns), class indices or normalised vectors.
            groups: n names; samples of one name are left out together.
            asked: (m, d).
        """
        known, asked = ridge_regression.standardise(known, asked)
        gram, cross = (known @ known.T).double(), (asked @ known.T).double()
        solved = {
            name: self.solve_part(part, gram, cross, truth[name], groups)
            for name, part in self.parts.items()
        }
        inner, outer = ({name: pair[i] for name, pair in solved.items()} for i in range(2))
        return inner, outer

    def solve_part(
        self, part: TargetPart, gram: Tensor, cross: Tensor, truth: Tensor, groups: Sequence[str]
    ) -> tuple[Tensor, Tensor]:
        """The same for one part.

        Args:
            part: What is predicted.
            gram: float64 (n, n), products of the training samples.
            cross: float64 (m, n), products of new samples with these.
            truth: (n, columns).
            groups: See `solve`.
        """
        fit = ridge_regression.fit_ridge(gram, _coded(part, truth))
        places = places_of(groups)
        tried = [fit.left_out(penalty, places) for penalty in fit.penalties]
        best = _best(part, torch.stack(tried), truth)
        used = sorted(set(best.tolist()))
        far = [cross @ fit.dual(fit.penalties[i]) + fit.mean for i in used]
        where = torch.tensor([used.index(i) for i in best.tolist()])
        return _decoded(part, _chosen(tried, best)), _decoded(part, _chosen(far, where))


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
        part: What is predicted.
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
    """What goes as the balanced accuracy, float64 (penalties,).

    Args:
        part: What is predicted.
        tried: (penalties, n, columns), class indices.
        truth: (n, columns).
    """
    return ((tried == truth).double() * class_weights(part, truth)[truth.long()]).sum((1, 2))


def class_weights(part: TargetPart, truth: Tensor) -> Tensor:
    """Weight of a sample of each class with which all count the same, float64 (classes,)."""
    count = torch.bincount(truth.flatten().long(), minlength=len(part.names))
    return 1 / count.clamp(min=1).double()


def _chosen(rows: Sequence[Tensor], best: Tensor) -> Tensor:
    """Gathers each column from its chosen row, (n, k)."""
    stacked = torch.stack(list(rows))
    return stacked[best, :, torch.arange(len(best))].T
