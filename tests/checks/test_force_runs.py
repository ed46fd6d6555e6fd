"""Forces with one value repeated, a late start or an early end."""

import numpy as np
import pytest

from tactileforge.checks.force_runs import away, stuck

TIMES = np.arange(600) / 30


def noisy() -> np.ndarray:
    rng = np.random.default_rng(0)
    return rng.normal((0, 0, 3), 0.05, (600, 3)).astype(np.float32)


@pytest.mark.parametrize("seconds", [2.2, 3.0, 8.0])
def test_one_value_for_seconds_of_twenty(seconds: float) -> None:
    force = noisy()
    force[200 : 201 + round(seconds * 30)] = force[200]
    assert stuck(force, TIMES) == f"{seconds:.3g} s of one and the same force"


def test_values_without_noise_may_rest() -> None:
    force = noisy()
    force[200:240] = force[200]
    assert stuck(force, TIMES) == "", "1.3 s"
    steps = np.repeat(noisy()[::20], 20, axis=0)
    steps[200:290] = steps[200]
    assert stuck(steps, TIMES) == "", "a simulated force, or one from a plot, in steps"
    force[200:300] = 0
    assert stuck(force, TIMES) == "", "lifted"


@pytest.mark.parametrize("rows", [slice(0, 90), slice(500, 600)])
def test_forces_that_start_late_or_end_early(rows: slice) -> None:
    force = noisy()
    force[rows] = np.nan
    words = "3 s until the first force" if rows.start == 0 else "3.33 s after the last force"
    assert away(force, TIMES) == words


def test_rare_forces_and_short_gaps_are_plausible() -> None:
    force = noisy()
    force[:50] = np.nan
    assert away(force, TIMES) == "", "1.7 s of 20"
    assert away(force, TIMES / 4) == "", "half a second"
    force[:] = np.nan
    assert away(force, TIMES) == ""
    force[100::7] = 1
    assert away(force, TIMES) == "", "rare"
