"""Names made of stamps, dates or numbers with holes give times; others give none."""

from datetime import UTC, datetime, timedelta

import numpy as np
import pytest

from tactileforge.reading.name_times import name_times

FPS = 30.0
#: Frames at 30 Hz with a hole of 0.8 s, and the jitter of a real camera.
TRUE = np.concatenate([np.arange(12), np.arange(36, 60)]) / FPS
TRUE = TRUE + np.random.default_rng(0).uniform(0, 0.004, len(TRUE))
TRUE -= TRUE[0]
DATE = 1763000000


def ns(seconds: float) -> int:
    return DATE * 10**9 + round(seconds * 1e9)


DATED = {
    "ns": [f"{ns(t)}" for t in TRUE],
    "us": [f"img_{ns(t) // 10**3}" for t in TRUE],
    "ms": [f"cam0_{ns(t) // 10**6}" for t in TRUE],
    "s": [f"{ns(t) / 1e9:.6f}" for t in TRUE],
    "numbered": [f"{i:04d}_{ns(t)}" for i, t in enumerate(TRUE)],
    "sec_nsec": [f"{ns(t) // 10**9}_{ns(t) % 10**9:09d}" for t in TRUE],
    "sec.nsec": [f"rgb_{ns(t) // 10**9}.{ns(t) % 10**9:09d}" for t in TRUE],
}


@pytest.mark.parametrize("kind", DATED)
@pytest.mark.parametrize("fps", [FPS, None])
def test_stamps(kind: str, fps: float | None) -> None:
    found = name_times(DATED[kind], fps)
    assert found.times is not None
    assert np.abs(found.times - TRUE).max() < 1.1e-3
    assert found.start == pytest.approx(DATE, abs=1e-3)
    assert found.doubt == ""


@pytest.mark.parametrize("form", ["%Y%m%d_%H%M%S_%f", "%Y-%m-%d %H-%M-%S.%f", "%Y%m%dT%H%M%S.%f"])
def test_dates(form: str) -> None:
    day = datetime(2026, 11, 5, 12, 30, 59, tzinfo=UTC)
    names = [(day + timedelta(seconds=t)).strftime(form) for t in TRUE.tolist()]
    found = name_times(names, FPS)
    assert found.times is not None
    assert np.abs(found.times - TRUE).max() < 1e-4
    assert found.start == pytest.approx(day.timestamp())


@pytest.mark.parametrize(("unit", "factor"), [("ms", 1e3), ("us", 1e6), ("ns", 1e9)])
def test_stamps_since_the_start_are_told_by_the_rate(unit: str, factor: float) -> None:
    names = [f"t{int(t * factor):012d}" for t in TRUE]
    found = name_times(names, FPS)
    assert found.times is not None
    assert np.abs(found.times - TRUE).max() < 1.1e-3
    assert found.start is None
    other = name_times(names, 10.0)
    assert other.times is None
    assert f"names may be times in {unit}, 30" in other.doubt
    given = name_times(names, 10.0, unit)
    assert given.times is not None
    assert np.abs(given.times - TRUE).max() < 1.1e-3


def test_holes_in_numbers_are_kept() -> None:
    numbers = np.round(TRUE * FPS).astype(int).tolist()
    for names in ([f"frame_{i:05d}" for i in numbers], [f"{i + 7}_rgb" for i in numbers]):
        found = name_times(names, FPS)
        assert found.times is not None
        np.testing.assert_allclose(found.times, np.array(numbers) / FPS)
    every_fifth = name_times([f"f{5 * i}" for i in (0, 1, 2, 5, 6)], FPS)
    assert every_fifth.times is not None
    np.testing.assert_allclose(every_fifth.times * FPS, [0, 1, 2, 5, 6])


def test_seconds_in_names() -> None:
    found = name_times([f"{t:.3f}" for t in TRUE], FPS)
    assert found.times is not None
    assert np.abs(found.times - TRUE).max() < 1e-3
    assert "names may be seconds" in name_times([f"{t:.3f}" for t in TRUE], 60.0).doubt


@pytest.mark.parametrize(
    "names",
    [
        ["0", "1", "2"],
        ["3", "4", "5"],
        ["0", "10", "20", "30"],
        ["a", "b", "c"],
        ["x1", "y2", "z7"],
        [f"gp_{8 + 0.2 * i:.2f}_f{i}" for i in range(9)],
        [f"gp_{8 + 0.2 * i:.2f}" for i in range(9)],
        [f"20261105_123059_{i:06d}" for i in range(9)],
        ["only"],
    ],
)
def test_other_names_say_nothing(names: list[str]) -> None:
    found = name_times(names, FPS)
    assert found.times is None or len(names) == 1
    assert found.doubt == ""


def test_what_is_not_clear_is_said() -> None:
    assert "do not increase" in name_times([f"{DATE + i // 3}" for i in range(9)], FPS).doubt
    rate = name_times([f"{DATE * 1000 + 100 * i}" for i in range(9)], FPS)
    assert rate.times is not None
    assert rate.doubt == "names come 10 times a second and fps is 30; the names count"


NS = [1699999999123456789 + 33333333 * i for i in range(40)]
DAYS = [datetime.fromtimestamp(ns / 1e9, UTC) for ns in NS]


def of_parts(text: str, divide: int = 1) -> list[str]:
    """Names of seconds, and of the rest in a unit."""
    return [text.format(ns // 10**9, ns % 10**9 // divide, i) for i, ns in enumerate(NS)]


@pytest.mark.parametrize(
    "names",
    [
        of_parts("{0}.{1:09d}"),
        of_parts("{0}_{1:09d}"),
        of_parts("{0}_{1}"),
        of_parts("{0}-{1:06d}", 1000),
        of_parts("{0}_{1:03d}", 10**6),
        of_parts("{0}_{1}", 10**6),
        of_parts("{2:06d}_{0}_{1:09d}"),
        of_parts("{0}_{1:03d}_{2}", 10**6),
        [f"frame_{i:06d}_{ns // 10**6}" for i, ns in enumerate(NS)],
        [day.strftime("%Y-%m-%dT%H-%M-%S.%f") for day in DAYS],
        [day.strftime("%Y%m%dT%H%M%S%f") for day in DAYS],
        [day.strftime("%Y%m%d_%H%M%S") + f"{day.microsecond // 1000:03d}" for day in DAYS],
        [day.strftime("%d-%m-%Y_%H-%M-%S-%f") for day in DAYS],
        [day.strftime("%m-%d-%Y %I-%M-%S.%f %p") for day in DAYS],
        [day.strftime("%d-%b-%Y-%H-%M-%S-%f") for day in DAYS],
        [day.strftime("touch_%H_%M_%S_%f") for day in DAYS],
        [day.strftime("%H:%M:%S.%f") for day in DAYS],
    ],
    ids=lambda names: names[0],
)
@pytest.mark.parametrize("fps", [30.0, 15.0, None])
def test_names_with_stamps_of_any_kind_give_times(names: list[str], fps: float | None) -> None:
    found = name_times(names, fps)
    assert found.times is not None
    np.testing.assert_allclose(found.times, np.arange(40) / 30, atol=1.1e-3)
    assert bool(found.doubt) == (fps == 15.0), "another rate is said"


def test_times_of_day_go_on_after_midnight() -> None:
    found = name_times(["23-59-59.950", "23-59-59.984", "00-00-00.017", "00-00-00.051"], 30.0)
    assert found.times is not None
    np.testing.assert_allclose(found.times, [0, 0.034, 0.067, 0.101])


def test_counters_behind_seconds_are_no_parts_of_them() -> None:
    for first in (0, 1000):
        names = [f"{DATE + i // 30}_{first + i:04d}" for i in range(900)]
        found = name_times(names, FPS)
        assert found.times is None
        assert "do not increase" in found.doubt


def test_nanoseconds_without_their_zeros_are_no_fractions() -> None:
    found = name_times(sorted(of_parts("{0}.{1}"), key=float), FPS)
    assert found.times is None
    assert "lack their leading zeros" in found.doubt


def test_a_doubt_without_a_rate() -> None:
    assert name_times([f"{t:.6f}" for t in TRUE], None).doubt.endswith("a second")
