"""The probe ``linear``: a linear layer, fitted until it has converged, its penalty chosen."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import ClassVar

import torch
from torch import Tensor

from tactileforge_bench.fit.probes import convex
from tactileforge_bench.fit.probes.base import Probe, Values
from tactileforge_bench.fit.probes.ridge_regression import feature_scale
from tactileforge_bench.tasks.targets import TargetPart

#: Penalties on the squared weights that are tried, strongest first.
PENALTIES = tuple(10.0 ** (-power / 2) for power in range(-2, 11))


class Linear(Probe):
    """Logistic regression by L-BFGS on standardised features; nothing is drawn at random.

    Minimises the mean cross-entropy of classes, or half the mean squared error of numbers, plus
    half the penalty times the squared weights; the problem is convex, so it has one solution.
    Validation chooses the penalty, and the layer is fitted again with it on training and
    validation together.

    Args:
        width: Size of the projected class token.
        parts: Parts of the target.
        penalties: Penalties that are tried.
    """

    tap: ClassVar[str] = "projected"
    trained: ClassVar[bool] = False

    def __init__(
        self,
        width: int,
        parts: Mapping[str, TargetPart],
        penalties: Sequence[float] = PENALTIES,
    ) -> None:
        super().__init__(width, parts)
        self.penalties = sorted(map(float, penalties), reverse=True)
        self.width = width

    def choose(
        self,
        known: Tensor,
        truth: Values,
        asked: Tensor,
        score: Callable[[Values], float],
        higher: bool,
    ) -> tuple[float, float]:
        """Chooses the penalty with the best validation score; also that score.

        Args:
            known: (n, width), features of the training samples.
            truth: (n, columns), class indices or normalised vectors.
            asked: (m, width), features of the validation samples.
            score: Metric of predictions of these.
            higher: Whether a higher score is better.
        """
        layers = self.path(known, truth, self.penalties)
        scores = [score(self.predict(layer, asked)) for layer in layers]
        best = (max if higher else min)(range(len(scores)), key=scores.__getitem__)
        return self.penalties[best], scores[best]

    def fit(self, known: Tensor, truth: Values, penalty: float) -> Values:
        """The fitted layer of each part, float64 (width + 1, outputs), for features as they are.

        Args:
            known: (n, width).
            truth: (n, columns), class indices or normalised vectors.
            penalty: Penalty on the squared weights of standardised features.
        """
        return self.path(known, truth, [penalty])[0]

    def path(self, known: Tensor, truth: Values, penalties: Sequence[float]) -> list[Values]:
        """The same for several penalties, each started at the solution of the one before."""
        # in float32 the line search ends before the gradient is small enough
        known = known.double()
        mean, factor = feature_scale(known)
        axes = convex.axes_of((known - mean) * factor)
        layers: list[Values] = [{} for _ in penalties]
        for name, part in self.parts.items():
            error = self._error(part, truth[name])
            weight = known.new_zeros(self.width + 1, part.outputs)
            for layer, penalty in zip(layers, penalties, strict=True):
                weight = convex.fit_layer(axes, error, penalty, weight)
                plain = weight[:-1] * factor[:, None]
                layer[name] = torch.cat([plain, (weight[-1] - mean @ plain)[None]])
        return layers

    def _error(self, part: TargetPart, truth: Tensor) -> Callable[[Tensor], Tensor]:
        if part.kind == "classes":
            return lambda out: self.loss_of(part, out, truth)
        return lambda out: (out - truth).square().mean() / 2

    def scores(self, layer: Mapping[str, Tensor], asked: Tensor) -> Values:
        """Logits of classes or normalised vectors of each part, float64 (m, outputs)."""
        asked = asked.double()
        return {name: asked @ weight[:-1] + weight[-1] for name, weight in layer.items()}

    def predict(self, layer: Mapping[str, Tensor], asked: Tensor) -> Values:
        """Class indices or normalised vectors of each part, float32 (m, columns)."""
        decoded = self.decode(self.scores(layer, asked))
        return {name: values.float().cpu() for name, values in decoded.items()}
