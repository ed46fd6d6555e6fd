"""Misfitting times are recognised by their unit, zero or rate; others pass."""

import numpy as np
import pytest
from numpy.typing import NDArray

from tactileforge.data.labels.clock import date_unit, misfit, seconds_of
from tactileforge.errors import ConfigError

FRAMES = np.arange(68) / 30
ROWS = np.arange(0, 2.25, 0.01)


@pytest.mark.parametrize(
    "rows",
    [
        ROWS,
        ROWS[60:],
        ROWS[:150],
        np.arange(-1, 5, 0.01),
        np.arange(0, 1800, 0.01),
        np.arange(0, 3.0),
        np.arange(0, 2.3, 0.2),
        ROWS * 1.1,
        FRAMES[:-1],
        np.array([0.0, 2.3]),
        ROWS * 1.5,
    ],
    ids=lambda rows: f"{len(rows)}_{rows[0]:g}_{rows[-1]:g}",
)
def test_sane_tables_pass(rows: NDArray[np.float64]) -> None:
    assert misfit(rows, FRAMES) is None


@pytest.mark.parametrize(("unit", "factor"), [("ms", 1e3), ("us", 1e6), ("ns", 1e9)])
@pytest.mark.parametrize(
    ("zero", "words"), [(0, "?"), (1.7e9, " since 1970?"), (3600, " of another zero?")]
)
def test_another_unit_is_named(unit: str, factor: float, zero: float, words: str) -> None:
    found = misfit((ROWS + zero) * factor, FRAMES)
    assert found is not None
    assert (found.unit, found.plain, found.certain) == (unit, zero == 0, True)
    full = {"ms": "milliseconds", "us": "microseconds", "ns": "nanoseconds"}[unit]
    assert found.words.endswith(f"the recording at 2.23 s: is it {full}{words}")


@pytest.mark.parametrize("rate", [25, 100, 1000])
@pytest.mark.parametrize("seconds", [1.0, 2.2, 5.0])
def test_milliseconds_are_told_at_any_rate_and_length(rate: float, seconds: float) -> None:
    found = misfit(np.arange(0, seconds, 1 / rate) * 1000, FRAMES)
    assert found is not None
    assert found.unit == "ms"


@pytest.mark.parametrize(
    ("rows", "words"),
    [
        (ROWS + 1.7e9, "1700000000 to 1700000002 and does not overlap the times of the frames (0"),
        (ROWS + 5, "goes from 5 to 7.24 and does not overlap"),
        (ROWS - 5, "goes from -5 to -2.76 and does not overlap"),
        (ROWS * 2, "2 times as long: is the rate"),
        (ROWS / 2, "half as long: is the rate"),
        (ROWS / 60, "0.017 times as long: is the rate or unit"),
        (FRAMES * 1.25, "1.25 times as long: is the rate"),
        (FRAMES * 0.8, "0.8 times as long: is the rate"),
        (ROWS + 1, "as long but 1 s late: is it another zero?"),
        (ROWS - ROWS[-1], "as long but 2.24 s early: is it another zero?"),
        (np.arange(225.0), "ends at 224, the recording at 2.23 s: is it the number of the row?"),
        (ROWS * 100 + 0.5, "ends at 224.5, the recording at 2.23 s: is it another unit?"),
        (np.arange(68.0), "ends at 67, the recording at 2.23 s: is it the number of the frame?"),
    ],
)
def test_another_zero_or_rate_is_named(rows: NDArray[np.float64], words: str) -> None:
    found = misfit(rows, FRAMES)
    assert found is not None
    assert words in found.words
    assert found.certain


def test_a_rate_that_would_fit_is_named() -> None:
    found = misfit(ROWS * 2, FRAMES)
    assert found is not None
    assert found.fix == "100 rows a second would fit, or fps: 15.1"
    assert misfit(ROWS * 2, FRAMES, partial=True) is None, "who says so is believed"
    assert misfit(ROWS * 1000, FRAMES, partial=True) is not None, "but not with another unit"


def test_numbers_of_rows_name_the_rate_and_may_be_right() -> None:
    found = misfit(np.arange(225.0), FRAMES)
    assert found is not None
    assert found.fix == "give seconds since the first frame (100 rows a second would fit)"
    assert misfit(np.arange(225.0), FRAMES, partial=True) is None


@pytest.mark.parametrize("ratio", [24 / 30, 25 / 30, 30 / 25, 30 / 24])
def test_another_rate_of_videos_is_said(ratio: float) -> None:
    found = misfit(ROWS * ratio, FRAMES)
    assert found is not None
    assert not found.certain
    assert "are 25 frames a second taken for 30, or the like?" in found.words
    assert misfit(ROWS * ratio + 0.2, FRAMES) is None, "starts late"
    assert misfit(ROWS * ratio, FRAMES, partial=True) is None


def test_few_labels_are_no_error() -> None:
    found = misfit(ROWS[200:], FRAMES)
    assert found is not None
    assert not found.certain
    assert "only 12 % of them get a label" in found.words


def test_a_still_has_no_clock() -> None:
    still = np.zeros(1)
    assert misfit(ROWS + 3, still) is None
    assert misfit(ROWS + 1.7e9, still) is not None
    assert misfit(np.zeros(0), FRAMES) is None


def test_units() -> None:
    assert [date_unit(1.7e9 / s * np.ones(2)) for s in (1, 1e-3, 1e-6, 1e-9)] == [
        "s",
        "ms",
        "us",
        "ns",
    ]
    assert date_unit(ROWS) == ""
    assert seconds_of("ms", "") == 1e-3
    with pytest.raises(ConfigError, match=r"here: unknown unit 'msec'.*'ms'"):
        seconds_of("msec", "here")
