"""Means over seeds, with their 95 % intervals."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from statistics import fmean, variance

LEVEL = 0.95


@dataclass(frozen=True)
class Interval:
    """A mean and the half-width of its 95 % interval.

    Attributes:
        mean: The mean.
        half: Half the width of the 95 % interval; NaN where one value gives none.
        values: Averaged values.
    """

    mean: float
    half: float
    values: tuple[float, ...]


def mean_interval(values: Sequence[float]) -> Interval:
    """The mean of finite values, with Student's t.

    Example:
        >>> round(mean_interval([1.0, 2.0, 3.0]).half, 3)  # 4.303 / sqrt(3)
        2.484
    """
    count = len(values)
    half = math.nan
    if count > 1:
        half = student_t(count - 1) * math.sqrt(variance(values) / count)
    return Interval(fmean(values), half, tuple(values))


def difference_interval(a: Interval, b: Interval) -> Interval:
    """The difference of two means, a - b, with Student's t and the pooled variance.

    One value against several has an interval too: its variance is taken to be theirs.
    """
    freedom = len(a.values) + len(b.values) - 2
    half = math.nan
    if freedom > 0:
        squares = sum((len(x.values) - 1) * variance(x.values) for x in (a, b) if len(x.values) > 1)
        spread = squares / freedom * (1 / len(a.values) + 1 / len(b.values))
        half = student_t(freedom) * math.sqrt(spread)
    return Interval(a.mean - b.mean, half, ())


@cache
def student_t(freedom: int) -> float:
    """Two-sided 95 % quantile of Student's t distribution.

    By bisection of the closed form for whole degrees of freedom (Abramowitz and Stegun, 26.7.3 and
    26.7.4).
    """
    low, high = 0.0, math.pi / 2
    # each step halves the interval: below the spacing of doubles after 53
    for _ in range(60):
        middle = (low + high) / 2
        low, high = (middle, high) if _within(middle, freedom) < LEVEL else (low, middle)
    return math.sqrt(freedom) * math.tan(high)


def _within(angle: float, freedom: int) -> float:
    """Probability of ``|t| < sqrt(freedom) * tan(angle)``."""
    sine, cosine = math.sin(angle), math.cos(angle)
    odd = freedom % 2
    term = cosine if odd else 1.0
    total = term if freedom > 1 else 0.0
    for i in range(2 + odd, freedom - 1, 2):
        term *= cosine**2 * (i - 1) / i
        total += term
    return 2 / math.pi * (angle + sine * total) if odd else sine * total
