"""Frames stored more often than the camera gave them, at any ratio; and what only looks alike."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from tactileforge.checks.made import made_touch, pictures, press
from tactileforge.checks.repeats import every, repeated
from tactileforge.data.frames.lazy import ArrayFrames
from tactileforge.reading.reader import thinned


def changes(frames: NDArray[np.uint8]) -> NDArray[np.float64]:
    return np.abs(np.diff(frames.astype(np.int16), axis=0)).mean((1, 2, 3))


def stored(camera: float, rate: float, seed: int = 0, count: int = 64) -> NDArray[np.uint8]:
    """Frames of a camera as a recorder stores them at its own rate."""
    needed = int(count * camera / rate) + 2
    depth = 0.5 + 0.5 * np.sin(np.arange(needed) / 7)
    rows = (np.arange(count) * camera / rate + 0.3).astype(int)
    return pictures(depth, seed)[rows]


@pytest.mark.parametrize(
    ("camera", "rate"), [(30, 60), (20, 60), (15, 60), (18, 30), (24, 30), (25, 30), (50, 60)]
)
@pytest.mark.parametrize("noise", [0, 1])
def test_a_camera_that_is_slower_than_the_recorder(camera: float, rate: float, noise: int) -> None:
    frames = stored(camera, rate)
    if noise:  # encoded again: a copy differs by a little here and there
        rng = np.random.default_rng(1)
        frames = frames + (rng.random(frames.shape) < 0.03).astype(np.uint8)
    found = repeated(changes(frames), rate)
    assert found is not None
    assert found.value == pytest.approx(1 - camera / rate, abs=0.03)
    given = float(found.words.partition("about ")[2].split()[0])
    assert given == pytest.approx(camera, rel=0.05)


@pytest.mark.parametrize("times", [1, 2, 3])
def test_copies_in_a_film_whose_coder_refines_them(tmp_path: Path, times: int) -> None:
    once = pictures(0.5 + 0.5 * np.sin(np.arange(64 // times) / 3))
    path = tmp_path / "film.mp4"
    film = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"mp4v"), 60, (60, 80))
    for frame in np.repeat(once, times, 0):
        film.write(frame)
    film.release()
    decoded = cv2.VideoCapture(str(path))
    kept = np.stack([decoded.read()[1] for _ in range(len(once) * times)])
    steps = changes(kept)
    found = repeated(steps, 60)
    assert (found and found.value) == (None if times == 1 else pytest.approx(1 - 1 / times))
    if times > 1:
        copies = np.delete(steps, np.s_[times - 1 :: times])
        assert np.quantile(copies, 0.75) > 0.1 * np.median(steps[times - 1 :: times]), (
            "they do differ"
        )


@pytest.mark.parametrize("camera", [30, 29, 58])
def test_a_camera_of_the_same_rate_is_passed(camera: float) -> None:
    rate = 30 if camera < 40 else 60
    assert repeated(changes(stored(camera, rate)), rate) is None


def test_a_gel_at_rest_and_lost_frames_are_no_rhythm() -> None:
    frames = pictures(press(64))
    frames[:30] = frames[0]  # drawn without noise, at rest
    assert repeated(changes(frames), 30) is None
    lost = pictures(0.5 + 0.5 * np.sin(np.arange(64) / 7))
    for row in np.random.default_rng(3).choice(np.arange(1, 64), 14, replace=False):
        lost[row] = lost[row - 1]  # at random, not by a rate
    assert repeated(changes(lost), 30) is None
    assert repeated(np.zeros(63), 30) is None
    assert repeated(np.zeros(0), 30) is None


@pytest.mark.parametrize(("camera", "rate"), [(30, 60), (20, 60), (18, 30)])
def test_the_key_keeps_one_of_each_frame(camera: float, rate: float) -> None:
    rows = (np.arange(90) * camera / rate + 1e-9).astype(int)
    film = pictures(0.5 + 0.5 * np.sin(np.arange(rows[-1] + 1) / 7))[rows]
    force = np.repeat(rows[:, None], 3, 1).astype(np.float32)
    one = made_touch(frames=ArrayFrames(film), force=force)
    factor = every(1 - camera / rate)
    kept = thinned(one, factor)
    assert kept.force is not None
    shown = kept.force[:, 0].astype(int)
    assert np.array_equal(shown, np.unique(shown)), "no frame of the camera comes twice"
    assert len(shown) >= 0.95 * (rows[-1] + 1), "and hardly any is left out"
    assert repeated(changes(kept.frames.read(range(len(shown)))), camera) is None
    assert thinned(one, 1.0) is one
