"""Metrics by name.

``rmse_sum_axes`` is what AnyTouch 2 reports, ``mae_mean_axes`` what Sparsh calls RMSE: the mean
over samples and axes of the root of each squared error.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import torch
from torch import Tensor
from torchmetrics import Metric
from torchmetrics.classification import BinaryF1Score, MulticlassAccuracy, MulticlassF1Score

from tactileforge.bench.tasks.targets import Part
from tactileforge.errors import ConfigError, DataError, unknown

#: Millinewton in a newton.
_MN = 1000.0


class AxisErrors(Metric):
    """Sums over samples that metrics of vectors are made of; forces in newton.

    Args:
        axes: Number of axes.
    """

    full_state_update = False
    squared: Tensor
    absolute: Tensor
    distance: Tensor
    count: Tensor

    def __init__(self, axes: int = 3) -> None:
        super().__init__()
        self.add_state("squared", torch.zeros(axes, dtype=torch.float64), dist_reduce_fx="sum")
        self.add_state("absolute", torch.zeros(axes, dtype=torch.float64), dist_reduce_fx="sum")
        self.add_state("distance", torch.zeros((), dtype=torch.float64), dist_reduce_fx="sum")
        self.add_state("count", torch.zeros((), dtype=torch.float64), dist_reduce_fx="sum")

    def update(self, predicted: Tensor, truth: Tensor) -> None:
        """Adds samples, (n, axes)."""
        error = predicted.double() - truth.double()
        self.squared += (error**2).sum(0)
        self.absolute += error.abs().sum(0)
        self.distance += error.norm(dim=1).sum()
        self.count += len(error)

    def axes(self) -> Tensor:
        """Root mean squared error of each axis."""
        return (self.squared / self.count).sqrt()

    def compute(self) -> Tensor:
        """Root mean squared error of each axis, as it came."""
        return self.axes()


class RmseSumAxes(AxisErrors):
    """Root mean squared error of each axis, summed over the axes, mN (AnyTouch 2).

    Example:
        >>> import torch
        >>> metric = RmseSumAxes()
        >>> metric.update(torch.tensor([[1.0, 0.0, 2.0]]), torch.zeros(1, 3))
        >>> metric.compute().item()
        3000.0
    """

    def compute(self) -> Tensor:
        """See the class."""
        return self.axes().sum() * _MN


class MaeMeanAxes(AxisErrors):
    """Mean absolute error over samples and axes, mN (what Sparsh calls RMSE)."""

    def compute(self) -> Tensor:
        """See the class."""
        return (self.absolute / self.count).mean() * _MN


class RmseAxis(AxisErrors):
    """Root mean squared error of one axis, mN.

    Args:
        axis: 0 for x, 1 for y, 2 for z.
    """

    def __init__(self, axis: int) -> None:
        super().__init__()
        self.axis = axis

    def compute(self) -> Tensor:
        """See the class."""
        return self.axes()[self.axis] * _MN


class Distance(AxisErrors):
    """Mean distance in the image, percent of its width."""

    def __init__(self) -> None:
        super().__init__(2)

    def compute(self) -> Tensor:
        """See the class."""
        return self.distance / self.count * 100


class R2(Metric):
    """Coefficient of determination of each axis, mean over the axes.

    Args:
        axes: Number of axes.
        axis: One of them alone; -1 for their mean.
    """

    full_state_update = False
    moments: Tensor

    def __init__(self, axes: int = 3, axis: int = -1) -> None:
        super().__init__()
        self.axis = axis
        self.add_state("moments", torch.zeros(4, axes, dtype=torch.float64), dist_reduce_fx="sum")

    def update(self, predicted: Tensor, truth: Tensor) -> None:
        """Adds samples, (n, axes)."""
        y, error = truth.double(), predicted.double() - truth.double()
        self.moments += torch.stack([torch.ones_like(y), y, y * y, error**2]).sum(1)

    def compute(self) -> Tensor:
        """See the class."""
        n, y, yy, ee = self.moments
        scores: Tensor = 1 - ee / (yy - y * y / n)
        return scores.mean() if self.axis < 0 else scores[self.axis]


class Correlation(Metric):
    """Pearson's correlation of each axis, mean over the axes; NaN where the truth stands still.

    Args:
        axes: Number of axes.
    """

    full_state_update = False
    moments: Tensor

    def __init__(self, axes: int = 3) -> None:
        super().__init__()
        self.add_state("moments", torch.zeros(6, axes, dtype=torch.float64), dist_reduce_fx="sum")

    def update(self, predicted: Tensor, truth: Tensor) -> None:
        """Adds samples, (n, axes)."""
        x, y = predicted.double(), truth.double()
        self.moments += torch.stack([torch.ones_like(x), x, y, x * x, y * y, x * y]).sum(1)

    def compute(self) -> Tensor:
        """See the class."""
        n, x, y, xx, yy, xy = self.moments
        covariance = xy - x * y / n
        spread: Tensor = ((xx - x * x / n) * (yy - y * y / n)).sqrt()
        mean: Tensor = (covariance / spread).mean()
        return mean


class Percent(Metric):
    """A metric of classes, in percent; several columns of classes count as more samples.

    Args:
        metric: Of class indices, between 0 and 1.
    """

    full_state_update = False

    def __init__(self, metric: Metric) -> None:
        super().__init__()
        self.metric = metric

    def update(self, predicted: Tensor, truth: Tensor) -> None:
        """Adds samples, (n, columns)."""
        self.metric.update(predicted.flatten().long(), truth.flatten().long())

    def compute(self) -> Tensor:
        """See the class."""
        out: Tensor = self.metric.compute() * 100
        return out


def _accuracy(part: Part) -> Metric:
    return Percent(MulticlassAccuracy(len(part.names), average="micro"))


def _balanced(part: Part) -> Metric:
    return Percent(MulticlassAccuracy(len(part.names), average="macro"))


def _f1(part: Part) -> Metric:
    """Of the second class where there are two; else the mean over classes."""
    if len(part.names) == 2:
        return Percent(BinaryF1Score())
    return Percent(MulticlassF1Score(len(part.names), average="macro"))


@dataclass(frozen=True)
class Kind:
    """A metric that a task may name.

    Attributes:
        of: Kinds of the part it measures, see `targets.Part`.
        unit: Of its values.
        better: ``lower`` or ``higher``.
        build: From the part.
    """

    of: tuple[str, ...]
    unit: str
    better: str
    build: Callable[[Part], Metric]


_VECTORS = ("force", "place", "numbers")

METRICS: dict[str, Kind] = {
    "accuracy": Kind(("classes",), "%", "higher", _accuracy),
    "balanced_accuracy": Kind(("classes",), "%", "higher", _balanced),
    "f1": Kind(("classes",), "%", "higher", _f1),
    "rmse_sum_axes": Kind(("force",), "mN", "lower", lambda _: RmseSumAxes()),
    "mae_mean_axes": Kind(("force",), "mN", "lower", lambda _: MaeMeanAxes()),
    **{
        f"rmse_{name}": Kind(
            ("force",), "mN", "lower", partial(lambda axis, _: RmseAxis(axis), axis)
        )
        for axis, name in enumerate("xyz")
    },
    "r2": Kind(_VECTORS, "", "higher", lambda part: R2(part.truth.shape[1])),
    **{
        f"r2_{name}": Kind(("force",), "", "higher", partial(lambda axis, _: R2(3, axis), axis))
        for axis, name in enumerate("xyz")
    },
    "correlation": Kind(("force",), "", "higher", lambda _: Correlation()),
    "distance": Kind(("place",), "% of width", "lower", lambda _: Distance()),
}


def kind(name: str) -> Kind:
    """A metric by name.

    Raises:
        ConfigError: No such metric; lists those that there are.
    """
    if name not in METRICS:
        raise ConfigError(unknown("metric", name, METRICS))
    return METRICS[name]


def part_of(name: str, parts: dict[str, Part]) -> str:
    """The first part of a target that a metric measures.

    Raises:
        ConfigError: None is of its kind.
    """
    wanted = kind(name).of
    for key, part in parts.items():
        if part.kind in wanted:
            return key
    raise ConfigError(
        f"metric {name} measures {' or '.join(wanted)}, which the target does not have"
    )


def measure(name: str, part: Part, predicted: Tensor, truth: Tensor) -> float:
    """The value of a metric.

    Args:
        name: See `METRICS`.
        part: What is predicted.
        predicted: (n, columns), newton or class indices.
        truth: Alike.

    Raises:
        DataError: The value is not finite.
    """
    metric = kind(name).build(part)
    metric.update(predicted, truth)
    value = float(metric.compute())
    if not torch.isfinite(torch.tensor(value)):
        raise DataError(
            f"metric {name} is {value} on {len(truth)} samples: predictions or truth are not "
            "finite, or the truth never changes; look at the data, or lower probe.lr"
        )
    return value
