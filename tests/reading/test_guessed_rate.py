"""Frames without times beside forces with some: the rate follows from their durations."""

from pathlib import Path

import numpy as np
import pytest
from videos import write_video

from tactileforge.data import encode_image
from tactileforge.datasets import Recordings
from tactileforge.reading.guessing.layout import guess_layout


def take(folder: Path, count: int, seconds: float, column: str = "t", unit: float = 1.0) -> None:
    """Images of a moving gel, and rising forces at 100 rows a second."""
    folder.mkdir()
    for number in range(count):
        picture = np.full((24, 32, 3), 90 + 4 * number, np.uint8)
        (folder / f"{number:04d}.png").write_bytes(encode_image(picture, "png"))
    times = np.arange(round(seconds * 100)) / 100
    rows = [f"{time / unit:g},0,0,{time:g}" for time in times]
    (folder / "ft.csv").write_text("\n".join([f"{column},fx,fy,fz", *rows]) + "\n")


def rate_and_line(root: Path) -> tuple[float, str]:
    guess = guess_layout(root)
    assert guess is not None
    (layout,) = guess.options["layouts"].values()
    (line,) = (line for line in guess.doubts if line.startswith("fps:"))
    return layout["fps"], line


@pytest.mark.parametrize("fps", [5, 10, 18, 20, 25, 50])
def test_the_rate_follows_from_the_duration_of_the_forces(fps: int, tmp_path: Path) -> None:
    for name, count in (("a", 20), ("b", 30)):
        take(tmp_path / name, count, count / fps)
    found, line = rate_and_line(tmp_path)
    assert found == pytest.approx(fps, rel=0.02)
    assert "all 2 recordings last as long as the forces" in line
    guess = guess_layout(tmp_path)
    assert guess is not None
    data = Recordings(**guess.options)
    for split in ("train", "val"):
        for one in data.recordings(split):
            assert one.force is not None
            known = np.isfinite(one.force[:, 2])
            assert known.mean() > 0.9
            wanted = np.arange(len(one.times))[known] / fps
            np.testing.assert_allclose(one.force[known, 2], wanted, rtol=0.02, atol=1e-6)


def test_a_rate_near_the_assumed_one_stays(tmp_path: Path) -> None:
    for name in "ab":
        take(tmp_path / name, 30, 1.1)  # 27 frames a second: a recorder that ran a little longer
    assert rate_and_line(tmp_path) == (30, "fps: 30 is assumed, names tell no times")


def test_forces_of_other_durations_tell_no_rate(tmp_path: Path) -> None:
    take(tmp_path / "a", 20, 1.0)
    take(tmp_path / "b", 20, 1.6)
    found, line = rate_and_line(tmp_path)
    assert found == 30
    assert "as long as frames at 12.5 to 20 a second" in line


def test_slow_frames_beside_milliseconds_tell_both(tmp_path: Path) -> None:
    for name, count in (("a", 20), ("b", 30)):
        take(tmp_path / name, count, count / 5, "time", 1e-3)
    guess = guess_layout(tmp_path)
    assert guess is not None
    (layout,) = guess.options["layouts"].values()
    assert layout["fps"] == 5
    assert layout["force"]["times"] == {"column": "time", "unit": "ms"}


def press(folder: Path, count: int, fps: float, seconds: float, film: float = 0) -> None:
    """A press within frames, as images or a film of another rate, and forces of other length."""
    folder.mkdir()
    times = np.arange(count) / fps
    middle, width = times[-1] / 2, times[-1] / 6
    levels = (90 + 60 * np.exp(-(((times - middle) / width) ** 2))).astype(np.uint8)
    pictures = [np.full((24, 32, 3), level, np.uint8) for level in levels]
    if film:
        write_video(folder / "gel.avi", pictures, fps=film)
    else:
        for number, picture in enumerate(pictures):
            (folder / f"{number:04d}.png").write_bytes(encode_image(picture, "png"))
    at = np.arange(round(seconds * 100)) / 100
    rows = [f"{now:g},0,0,{np.exp(-(((now - middle) / width) ** 2)):.6f}" for now in at]
    (folder / "ft.csv").write_text("\n".join(["t,fx,fy,fz", *rows]) + "\n")


def test_forces_recorded_for_longer_leave_a_rate_to_the_push(tmp_path: Path) -> None:
    for name in "ab":
        press(tmp_path / name, 30, 30, 3.0)
    found, line = rate_and_line(tmp_path)
    assert found == 30
    assert "fits that of the forces by it" in line
    assert line.endswith("frames at 10 a second; if that is right, give fps: 10")


def test_a_push_at_the_rate_of_the_forces_keeps_that_rate(tmp_path: Path) -> None:
    for name in "ab":
        press(tmp_path / name, 30, 10, 3.0)
    found, line = rate_and_line(tmp_path)
    assert found == 10
    assert "all 2 recordings last as long as the forces" in line


@pytest.mark.parametrize(("fps", "seconds", "says"), [(20, 1.5, True), (30, 1.5, False)])
def test_films_of_a_wrong_rate_are_told_by_push_and_forces(
    fps: int, seconds: float, says: bool, tmp_path: Path
) -> None:
    for name in "ab":
        press(tmp_path / name, 30, fps, seconds, film=30)
    guess = guess_layout(tmp_path)
    assert guess is not None
    (layout,) = guess.options["layouts"].values()
    assert "fps" not in layout
    line = (
        "fps: 30 by the films, but forces last as long as frames at 20 a second, and the push in "
        "the pictures fits theirs by it; if that is right, give fps: 20"
    )
    assert (line in guess.doubts) == says
    assert any(one.startswith("fps:") for one in guess.doubts) == says
