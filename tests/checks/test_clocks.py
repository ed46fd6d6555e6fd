"""Stamps of two clocks, and frames in pairs."""

import numpy as np
import pytest

from tactileforge.checks.clocks import clocks_apart, repeated_times

AT = np.arange(200) / 10
JITTER = np.random.default_rng(0).uniform(0, 0.03, 200)


@pytest.mark.parametrize(
    ("shift", "words"),
    [
        (37.0, "stamps of image are 37 s ahead of the times of recording, those of wrench 0.0"),
        (0.5, "stamps of image are 0.4"),
        (-0.5, "stamps of wrench are 0.0"),
        (-3600.0, "stamps of wrench are"),
    ],
)
def test_two_clocks(shift: float, words: str) -> None:
    told = clocks_apart({"image": (AT + shift, AT + JITTER), "wrench": (AT, AT + JITTER[::-1])})
    assert told.startswith(words)
    difference = float(told.rpartition("differ by ")[2].removesuffix(" s"))
    assert difference == pytest.approx(abs(shift), rel=0.02)


def test_one_clock_with_its_delays() -> None:
    assert clocks_apart({"image": (AT, AT + JITTER), "wrench": (AT, AT + 0.01)}) == ""
    far = {"image": (AT + 5, AT), "wrench": (AT + 5.01, AT)}
    assert clocks_apart(far) == "", "a clock of another zero, but one"
    assert clocks_apart({"image": (AT + 37, AT)}) == ""
    assert clocks_apart({"image": (AT[:2] + 37, AT[:2]), "wrench": (AT, AT)}) == "", "too few"


def test_frames_that_were_stored_twice_in_times() -> None:
    twice = np.sort(np.concatenate([AT, AT + 1e-4]))
    assert repeated_times(twice) == pytest.approx(0.5, abs=0.01)
    assert repeated_times(AT) == 0
    assert repeated_times(AT + np.random.default_rng(1).uniform(-0.04, 0.04, 200)) == 0
    assert repeated_times(AT[:3]) == 0
