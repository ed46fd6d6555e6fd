"""Score interval of the difference of two shares of the same trials."""

from __future__ import annotations

import math
from collections.abc import Sequence

from tactileforge_bench.results.bootstrap import ScoreInterval

from tactileforge_policies.rollouts.results import wilson


def paired_difference(ours: Sequence[bool], theirs: Sequence[bool]) -> ScoreInterval:
    """Difference of two shares of successes with its 95 % interval.

    The interval is that of Newcombe (Statistics in Medicine 17, 1998, method 10): Wilson intervals
    of both shares, joined with the correlation of the pairs. Unlike a bootstrap, it has a width
    even where all pairs agree.

    Args:
        ours: Success of each trial.
        theirs: Success of the other in the same trials, in the same order.

    Example:
        >>> found = paired_difference([False] * 20, [False] * 20)
        >>> round(found.low, 2), round(found.high, 2)
        (-0.16, 0.16)
    """
    count = len(ours)
    share, other = sum(ours) / count, sum(theirs) / count
    low, high = wilson(sum(ours), count)
    other_low, other_high = wilson(sum(theirs), count)
    related = _correlation(ours, theirs)
    value = share - other
    return ScoreInterval(
        value,
        value - _joined(share - low, other_high - other, related),
        value + _joined(high - share, other - other_low, related),
    )


def _correlation(ours: Sequence[bool], theirs: Sequence[bool]) -> float:
    """Correlation of the pairs, with Newcombe's continuity correction if it is positive."""
    count, won, lost = len(ours), sum(ours), sum(theirs)
    product = won * (count - won) * lost * (count - lost)
    if not product:
        return 0.0
    # n times the pairs won by both, minus its value by chance: the determinant of the 2 x 2 table.
    surplus = float(count * sum(a and b for a, b in zip(ours, theirs, strict=True)) - won * lost)
    if surplus > 0:
        surplus = max(0.0, surplus - count / 2)
    return surplus / math.sqrt(product)


def _joined(one: float, other: float, related: float) -> float:
    return math.sqrt(max(0.0, one**2 - 2 * related * one * other + other**2))
