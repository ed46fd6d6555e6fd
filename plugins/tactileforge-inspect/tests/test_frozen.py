"""Identical frames in the middle of a recording of any length."""

import numpy as np
import pytest
from tactileforge_inspect.frame_stats import frame_stats

from tactileforge.contracts import Recording
from tactileforge.data.frames.lazy import ArrayFrames


def take(count: int, frozen: slice | None = None, repeat: int = 1) -> Recording:
    rng = np.random.default_rng(0)
    film = rng.integers(90, 110, (count // repeat, 6, 8, 3), np.uint8).repeat(repeat, axis=0)
    if frozen:
        film[frozen] = film[frozen.start]
    times = np.arange(count) / 30
    frames = ArrayFrames(film)
    return Recording(key="a", sensor="digit", frames=frames, times=times, no_contact=None)


@pytest.mark.parametrize("start", [0, 31, 200, 255])
def test_a_freeze_is_measured_to_the_frame(start: int) -> None:
    assert frame_stats(take(300, slice(start, start + 40))).frozen == pytest.approx(39 / 30)


def test_a_freeze_in_a_long_take() -> None:
    """Three seconds of sixty: frames 2.6 s apart are looked at."""
    assert frame_stats(take(1800, slice(700, 790))).frozen == pytest.approx(89 / 30)


def test_frames_that_come_three_times_are_not_frozen() -> None:
    assert frame_stats(take(300, repeat=3)).frozen == pytest.approx(2 / 30)
    assert frame_stats(take(300)).frozen == 0
