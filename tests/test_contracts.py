"""A recording knows its period and its background, and gives some of its frames."""

import numpy as np
import pytest

from tactileforge.contracts import Recording
from tactileforge.data.frames.lazy import ArrayFrames


@pytest.fixture
def recording() -> Recording:
    frames = np.arange(6, dtype=np.uint8)[:, None, None, None] * np.ones((1, 2, 3, 3), np.uint8)
    return Recording(
        key="a",
        sensor="digit",
        frames=ArrayFrames(frames),
        times=np.array([0.0, 0.1, 0.2, 0.3, 0.8, 0.9]),
        no_contact=ArrayFrames(frames[[0, 5, 4]]),
        force=np.arange(18, dtype=np.float32).reshape(6, 3),
        action=np.arange(6),
        surface=ArrayFrames(frames[::-1].copy()),
        image=ArrayFrames(frames[:2]),
        tracks={"slip": np.arange(6) > 2},
    )


def test_period_is_the_median_and_0_of_one_frame(recording: Recording) -> None:
    assert recording.period == pytest.approx(0.1)  # one gap does not count
    assert recording.part(0, 1).period == 0.0


def test_background_is_the_median_of_the_frames_without_contact(recording: Recording) -> None:
    background = recording.background()
    assert background is not None
    assert background.dtype == np.uint8
    assert (background == 4).all()


def test_select_takes_every_column_of_the_frames(recording: Recording) -> None:
    some = recording.select([1, 4])
    assert some.times.tolist() == [0.1, 0.8]
    assert some.frames.read([0, 1])[:, 0, 0, 0].tolist() == [1, 4]
    assert some.force is not None
    assert some.force.tolist() == [[3, 4, 5], [12, 13, 14]]
    assert some.action is not None
    assert some.action.tolist() == [1, 4]
    assert some.surface is not None
    assert some.surface.read([0, 1])[:, 0, 0, 0].tolist() == [4, 1]
    assert some.tracks["slip"].tolist() == [False, True]
    assert some.image is recording.image


def test_part_takes_the_views_of_its_frames(recording: Recording) -> None:
    part = recording.part(3, 6)
    assert part.key == "a[3:6]"
    assert part.image is not None
    assert part.image.read([0, 1, 2])[:, 0, 0, 0].tolist() == [1, 1, 1]
