"""Metrics by name.

``rmse_sum_axes`` is what AnyTouch 2 reports, ``mae_mean_axes`` what Sparsh calls RMSE: the mean
over samples and axes of the root of each squared error.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from operator import itemgetter
from typing import Any

import torch
from torch import Tensor
from torchmetrics import MeanMetric, Metric
from torchmetrics.classification import BinaryF1Score, MulticlassAccuracy, MulticlassF1Score
from torchmetrics.regression import MeanAbsoluteError, MeanSquaredError, PearsonCorrCoef

from tactileforge.errors import ConfigError, DataError, unknown
from tactileforge_bench.tasks.targets import TargetPart

#: Millinewton in a newton.
_MN = 1000.0


class PerAxis(Metric):
    """A metric of each axis of a vector, in float64, reduced to one number.

    Args:
        metric: Metric of torchmetrics, with one output per axis.
        reduce: Function from the values of the axes, (axes,), to one number.

    Example:
        >>> import torch
        >>> metric = PerAxis(MeanSquaredError(squared=False, num_outputs=3), torch.sum)
        >>> metric.update(torch.tensor([[1.0, 0.0, 2.0]]), torch.zeros(1, 3))
        >>> metric.compute().item()
        3.0
    """

    full_state_update = False

    def __init__(self, metric: Metric, reduce: Callable[[Tensor], Tensor]) -> None:
        super().__init__()
        # sums of many squares of small forces lose digits in float32
        self.metric = metric.set_dtype(torch.float64)
        self.reduce = reduce

    def update(self, predicted: Tensor, truth: Tensor) -> None:
        """Adds samples, (n, axes)."""
        self.metric.update(predicted.double(), truth.double())

    def compute(self) -> Tensor:
        """The reduced value."""
        with warnings.catch_warnings():
            # torchmetrics warns of a constant axis; `measure` raises an error with the fix
            warnings.simplefilter("ignore")
            return self.reduce(self.metric.compute())


class Distance(Metric):
    """Mean distance in the image, percent of its width."""

    full_state_update = False

    def __init__(self) -> None:
        super().__init__()
        # NaN is kept, so that `measure` finds it: by default torchmetrics warns and leaves it out
        self.mean = MeanMetric(nan_strategy="disable").set_dtype(torch.float64)

    def update(self, predicted: Tensor, truth: Tensor) -> None:
        """Adds samples, (n, 2)."""
        self.mean.update((predicted.double() - truth.double()).norm(dim=1))

    def compute(self) -> Tensor:
        """The mean distance, percent."""
        percent: Tensor = self.mean.compute() * 100
        return percent


class R2(Metric):
    """Coefficient of determination of each axis, mean over the axes; NaN for a constant axis.

    `torchmetrics.R2Score` is no substitute: it takes sums of squares below 1e-4 for 0, which small
    forces in newton reach, and then gives 0 or 1.

    Args:
        axes: Number of axes.
        axis: One of them alone; -1 for their mean.
        floor: Least value. Without one a single probe that extrapolates to another unit, at -20,
            outweighs all other tasks in a mean.
    """

    full_state_update = False
    moments: Tensor

    def __init__(self, axes: int = 3, axis: int = -1, floor: float = -torch.inf) -> None:
        super().__init__()
        self.axis = axis
        self.floor = floor
        self.add_state("moments", torch.zeros(4, axes, dtype=torch.float64), dist_reduce_fx="sum")

    def update(self, predicted: Tensor, truth: Tensor) -> None:
        """Adds samples, (n, axes)."""
        y, error = truth.double(), predicted.double() - truth.double()
        self.moments += torch.stack([torch.ones_like(y), y, y * y, error**2]).sum(1)

    def compute(self) -> Tensor:
        """The mean over the axes, or the value of one."""
        n, y, yy, ee = self.moments
        scores: Tensor = 1 - ee / (yy - y * y / n)
        score = scores.mean() if self.axis < 0 else scores[self.axis]
        return score.clamp(min=self.floor)


class MeanRecall(Metric):
    """Mean recall of the classes in the truth.

    `torchmetrics.MulticlassAccuracy` is no substitute: it gives recall 0 to a class that is
    predicted and absent from the truth.

    Args:
        classes: Number of classes.
    """

    full_state_update = False
    counts: Tensor

    def __init__(self, classes: int) -> None:
        super().__init__()
        zeros = torch.zeros(2, classes, dtype=torch.long)
        self.add_state("counts", zeros, dist_reduce_fx="sum")

    def update(self, predicted: Tensor, truth: Tensor) -> None:
        """Adds samples, class indices (n,)."""
        classes = self.counts.shape[1]
        rows = [truth[truth == predicted], truth]
        self.counts += torch.stack([row.bincount(minlength=classes) for row in rows])

    def compute(self) -> Tensor:
        """The mean recall; NaN without samples."""
        right, count = self.counts.double()
        there = count > 0
        recalls: Tensor = right[there] / count[there]
        return recalls.mean()


class Percent(Metric):
    """A metric of classes, in percent; several columns of classes count as more samples.

    Args:
        metric: Metric of class indices, between 0 and 1.
    """

    full_state_update = False

    def __init__(self, metric: Metric) -> None:
        super().__init__()
        self.metric = metric

    def update(self, predicted: Tensor, truth: Tensor) -> None:
        """Adds samples, (n, columns)."""
        self.metric.update(predicted.flatten().long(), truth.flatten().long())

    def compute(self) -> Tensor:
        """The value, percent."""
        out: Tensor = self.metric.compute() * 100
        return out


def _rmse(reduce: Callable[[Tensor], Tensor]) -> Metric:
    """Root mean squared errors of force, mN, reduced over the axes."""
    rmse = MeanSquaredError(squared=False, num_outputs=3)
    return PerAxis(rmse, lambda axes: reduce(axes) * _MN)


def _of_numbers(metric: type[Metric], part: TargetPart, **options: Any) -> Metric:
    """An error of numbers in their own unit, mean over their columns."""
    return PerAxis(metric(num_outputs=part.truth.shape[1], **options), torch.mean)


@dataclass(frozen=True)
class MetricKind:
    """Definition of a metric for tasks.

    Attributes:
        of: Kinds of the part it measures, see `targets.TargetPart`.
        unit: Unit of its values; "" for a plain number, or one in the unit of the label.
        better: ``lower`` or ``higher``.
        build: Constructor of the metric, from the part.
    """

    of: tuple[str, ...]
    unit: str
    better: str
    build: Callable[[TargetPart], Metric]


_VECTORS = ("force", "place", "numbers")

METRICS: dict[str, MetricKind] = {
    "accuracy": MetricKind(
        ("classes",),
        "%",
        "higher",
        # micro: the share of samples; torchmetrics' own default is the mean over classes
        lambda part: Percent(MulticlassAccuracy(len(part.names), average="micro")),
    ),
    "balanced_accuracy": MetricKind(
        ("classes",), "%", "higher", lambda part: Percent(MeanRecall(len(part.names)))
    ),
    # of two classes that of the second, of more the mean
    "f1": MetricKind(
        ("classes",),
        "%",
        "higher",
        lambda part: Percent(
            BinaryF1Score()
            if len(part.names) == 2
            else MulticlassF1Score(len(part.names), average="macro")
        ),
    ),
    "rmse_sum_axes": MetricKind(("force",), "mN", "lower", lambda _: _rmse(torch.sum)),
    "mae_mean_axes": MetricKind(
        ("force",),
        "mN",
        "lower",
        lambda _: PerAxis(MeanAbsoluteError(num_outputs=3), lambda axes: axes.mean() * _MN),
    ),
    **{
        f"rmse_{name}": MetricKind(
            ("force",), "mN", "lower", partial(lambda axis, _: _rmse(itemgetter(axis)), axis)
        )
        for axis, name in enumerate("xyz")
    },
    "mae": MetricKind(("numbers",), "", "lower", partial(_of_numbers, MeanAbsoluteError)),
    "rmse": MetricKind(
        ("numbers",), "", "lower", partial(_of_numbers, MeanSquaredError, squared=False)
    ),
    "r2": MetricKind(_VECTORS, "", "higher", lambda part: R2(part.truth.shape[1])),
    "r2_bounded": MetricKind(
        _VECTORS, "", "higher", lambda part: R2(part.truth.shape[1], floor=0.0)
    ),
    **{
        f"r2_{name}": MetricKind(
            ("force",), "", "higher", partial(lambda axis, _: R2(3, axis), axis)
        )
        for axis, name in enumerate("xyz")
    },
    # Pearson's, mean over the axes; NaN for a constant axis
    "correlation": MetricKind(
        ("force",), "", "higher", lambda _: PerAxis(PearsonCorrCoef(num_outputs=3), torch.mean)
    ),
    "distance": MetricKind(("place",), "% of width", "lower", lambda _: Distance()),
}


def metric_kind(name: str) -> MetricKind:
    """A metric by name.

    Raises:
        ConfigError: No such metric; lists those that there are.
    """
    if name not in METRICS:
        raise ConfigError(unknown("metric", name, METRICS))
    return METRICS[name]


def part_of(name: str, parts: dict[str, TargetPart]) -> str:
    """Name of the first part of a target of a kind measured by a metric.

    Raises:
        ConfigError: No part is of a kind that it measures.
    """
    wanted = metric_kind(name).of
    for key, part in parts.items():
        if part.kind in wanted:
            return key
    kinds = list(dict.fromkeys(part.kind for part in parts.values()))
    fitting = [known for known, kind in METRICS.items() if set(kind.of) & set(kinds)]
    raise ConfigError(
        f"metric {name} measures {' or '.join(wanted)}, and the target is {' and '.join(kinds)}; "
        f"give one of: {', '.join(fitting)}"
    )


def measure(name: str, part: TargetPart, predicted: Tensor, truth: Tensor) -> float:
    """The value of a metric.

    Args:
        name: Key of `METRICS`.
        part: Part of the target.
        predicted: (n, columns), newton or class indices.
        truth: True values, (n, columns), in the same units.

    Raises:
        DataError: The value is not finite.
    """
    metric = metric_kind(name).build(part)
    metric.update(predicted, truth)
    value = float(metric.compute())
    if not torch.isfinite(torch.tensor(value)):
        raise DataError(
            f"metric {name} is {value} on {len(truth)} samples: predictions or truth are not "
            "finite, or the truth never changes; look at the data, or lower probe.lr"
        )
    return value
