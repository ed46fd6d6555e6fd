"""Clocks of sensors: late, slow or fast; busy machines are none of these."""

import numpy as np
import pytest

from tactileforge.sensors.clock_lag import ClockLag


def said(taken, arrived):
    lag = ClockLag()
    for one, now in zip(taken, arrived, strict=True):
        lag.add(float(one), float(now))
    return lag.trouble()


@pytest.mark.parametrize("seconds", [4, 60, 600])
@pytest.mark.parametrize(("rate", "words"), [(0.8, "20 % slow"), (1.2, "20 % fast"), (1.0, "")])
def test_a_clock_that_runs_at_another_rate(seconds, rate, words):
    now = np.arange(0, seconds, 1 / 30)
    jitter = np.random.default_rng(0).exponential(0.01, len(now))
    trouble = said(rate * now, now + jitter)
    assert trouble.startswith(f"its clock is {words}") if words else trouble == ""


def test_times_that_are_late_or_early():
    now = np.arange(0, 5, 1 / 30)
    assert said(now - 5, now) == (
        "its times are 5.0 s late: it is that far behind the other devices"
    )
    assert said(now + 0.5, now) == "its times are 0.5 s ahead of the clock"
    assert said(now - 0.4, now) == ""


def test_a_busy_machine_is_no_slow_clock():
    """Frames wait for seconds now and then, and for ever longer towards the end."""
    rng = np.random.default_rng(1)
    now = np.arange(0, 60, 1 / 30)
    waits = np.where(rng.random(len(now)) < 0.3, rng.exponential(0.5, len(now)), 0.001)
    assert said(now, np.maximum.accumulate(now + waits)) == ""
    stall = np.where(now > 40, 0.9, 0.0)
    assert said(now, now + stall) == ""
    assert said(now[:30], now[:30] + 3) == ""  # too few to tell


def test_memory_stays_small():
    lag = ClockLag()
    for second in range(100_000):
        lag.add(float(second), second + 0.01)
    assert len(lag._least) == len(lag._ends) <= 240
