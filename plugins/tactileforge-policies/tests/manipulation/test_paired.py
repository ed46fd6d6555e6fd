"""The paired score interval, against published examples."""

import pytest
from tactileforge_policies.manipulation.paired import paired_difference
from tactileforge_policies.rollouts.results import wilson


def pairs(both: int, ours: int, theirs: int, neither: int) -> tuple[list[bool], list[bool]]:
    """Trials of a 2 x 2 table."""
    table = [(True, True)] * both + [(True, False)] * ours
    table += [(False, True)] * theirs + [(False, False)] * neither
    return [won for won, _ in table], [won for _, won in table]


@pytest.mark.parametrize(
    ("table", "value", "low", "high"),
    [
        ((36, 12, 2, 0), 0.2, 0.0569, 0.3404),  # Newcombe, 1998, table II
        ((59, 6, 16, 80), -0.0621, -0.1186, -0.0046),  # Fagerland et al., 2017, chapter 8
        ((1, 1, 7, 12), -0.2857, -0.5069, -0.0256),  # the same chapter
    ],
)
def test_published_intervals_are_met(
    table: tuple[int, int, int, int], value: float, low: float, high: float
) -> None:
    found = paired_difference(*pairs(*table))
    assert (found.value, found.low, found.high) == pytest.approx((value, low, high), abs=5e-5)


def test_shares_that_never_differ_have_the_width_of_their_own_intervals() -> None:
    found = paired_difference(*pairs(0, 0, 0, 20))
    high = wilson(0, 20)[1]
    assert (found.low, found.high) == pytest.approx((-high, high))


def test_other_order_is_the_other_sign() -> None:
    ours, theirs = pairs(9, 4, 1, 6)
    one, other = paired_difference(ours, theirs), paired_difference(theirs, ours)
    assert (one.low, one.high) == pytest.approx((-other.high, -other.low))
