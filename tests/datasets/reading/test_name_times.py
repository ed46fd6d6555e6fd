"""Names made of stamps, dates or numbers with holes give times; others give none."""

from datetime import UTC, datetime, timedelta

import numpy as np
import pytest

from tactileforge.datasets.reading.name_times import name_times

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
