"""Courses of the learning rate: a factor of it, by the step of the run."""

from __future__ import annotations

import math


def _warmed(step: int, warm: int) -> float | None:
    """Linear warm-up, as in `linear`; None after it."""
    return (step + 1) / warm if step < warm else None


def _share(step: int, warm: int, total: int) -> float:
    """Share of the steps after the warm-up, 0 to 1."""
    return min(1.0, max(0.0, (step - warm) / max(1, total - warm)))


def linear(step: int, warm: int, total: int) -> float:
    """Linear warm-up, then a linear decay to 0 at the end of the run."""
    # + 1: the first step of a warm-up from 0 would be lost, as its rate is 0
    return max(0.0, min((step + 1) / warm, (total - step) / max(1, total - warm + 1)))


def cosine(step: int, warm: int, total: int) -> float:
    """Linear warm-up from 0, then half a cosine to 0 (Loshchilov and Hutter, 2017)."""
    if step < warm:
        return step / warm
    share = min(1.0, (step - warm) / max(1, total - warm))
    return 0.5 * (1.0 + math.cos(math.pi * share))


def constant(step: int, warm: int, total: int) -> float:
    """Linear warm-up from 0, then the full learning rate."""
    return min(1.0, step / warm)


def polynomial(step: int, warm: int, total: int) -> float:
    """Linear warm-up, then a decay to 0 with the square of what is left (`PolynomialLR`, power 2).

    Example:
        >>> polynomial(60, 20, 100)
        0.25
    """
    rising = _warmed(step, warm)
    return (1 - _share(step, warm, total)) ** 2 if rising is None else rising


def exponential(step: int, warm: int, total: int) -> float:
    """Linear warm-up, then a decay by a constant factor a step, to 1 % at the end.

    Example:
        >>> round(exponential(60, 20, 100), 3)
        0.1
    """
    rising = _warmed(step, warm)
    return 0.01 ** _share(step, warm, total) if rising is None else rising


def step(step: int, warm: int, total: int) -> float:
    """Linear warm-up, then a tenth of the rate after each third of what is left (`StepLR`).

    Example:
        >>> [round(step(n, 10, 100), 3) for n in (10, 45, 99)]
        [1.0, 0.1, 0.01]
    """
    rising = _warmed(step, warm)
    return 0.1 ** min(2, int(3 * _share(step, warm, total))) if rising is None else rising


def inverse_sqrt(step: int, warm: int, total: int) -> float:
    """Linear warm-up, then 1 / sqrt(step) (Vaswani et al., 2017).

    Example:
        >>> inverse_sqrt(399, 100, 1000)
        0.5
    """
    rising = _warmed(step, warm)
    return math.sqrt(warm / (step + 1)) if rising is None else rising


def warm_stable_decay(step: int, warm: int, total: int) -> float:
    """Linear warm-up, the full rate, then a linear decay to 0 in the last fifth (MiniCPM, 2024).

    Example:
        >>> [round(warm_stable_decay(n, 10, 100), 3) for n in (50, 91, 100)]
        [1.0, 0.5, 0.0]
    """
    rising = _warmed(step, warm)
    return min(1.0, 5 * (1 - _share(step, warm, total))) if rising is None else rising


def one_cycle(step: int, warm: int, total: int) -> float:
    """Half a cosine up from 4 % and half a cosine down to 0 (`OneCycleLR`; Smith, 2018).

    The rise takes the warm-up of ``optim.warmup``; Smith's is .3.

    Example:
        >>> [round(one_cycle(n, 30, 100), 2) for n in (0, 30, 65, 100)]
        [0.04, 1.0, 0.5, 0.0]
    """
    if step < warm:
        return 0.04 + 0.96 * 0.5 * (1 - math.cos(math.pi * step / warm))
    return 0.5 * (1 + math.cos(math.pi * _share(step, warm, total)))
