"""Folders of one's own with the names of a published set are read as one's own."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from made_sets import save_avi, save_picture
from videos import greys, write_video

from tactileforge.datasets.recognition import recognise
from tactileforge.plugins import registry

FORCES = "t,Fx,Fy,Fz\n" + "".join(f"{i / 25},0,0,{i / 10}\n" for i in range(8))


def _forces(path: Path) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(FORCES)


def _mov(root: Path) -> None:
    for name in ("trial_1", "trial_2", "mug_1"):
        write_video(root / f"{name}.mov", greys(8, 7, (240, 320)), codec="mp4v")
        _forces(root / f"{name}.csv")


def _gelsight_avi(root: Path) -> None:
    for name in ("trial_1", "trial_2"):
        save_avi(root / "mug" / name / "gelsight.avi", 8)
        _forces(root / "mug" / name / "ft.csv")


def _touch_and_vision(root: Path) -> None:
    for name in ("trial_1", "trial_2"):
        for i in range(8):
            save_picture(root / f"touch/{name}/frame{i:04d}.jpg", i)
            save_picture(root / f"vision/{name}/frame{i:04d}.jpg", i)
        _forces(root / f"force/{name}.csv")


def _gelsight_frame(root: Path) -> None:
    for top in ("dataset", "Data/cloth"):
        for name in ("trial_1", "trial_2"):
            for i in range(8):
                save_picture(root / top / name / f"gelsight_frame/{i:04d}.jpg", i)


def _pairs(root: Path) -> None:
    for i in range(8):
        save_picture(root / f"images_tac/image_{i}_tac.jpg", i)
        save_picture(root / f"images_rgb/image_{i}_rgb.jpg", i)


def _arrays(root: Path) -> None:
    for side, name in (("train", "trial_1"), ("train", "trial_2"), ("val", "trial_3")):
        (root / side).mkdir(exist_ok=True)
        np.save(root / side / f"{name}.npy", greys(8, 7))


def _episodes(root: Path) -> None:
    for name in ("ep_1", "ep_2"):
        write_video(root / name / "left.mp4", greys(8, 7), codec="mp4v")
        write_video(root / name / "right.mp4", greys(8, 7), codec="mp4v")
        (root / name / "episode.json").write_text(json.dumps({"object": "mug", "robot": "ur5"}))


def _moments(root: Path) -> None:
    for i in range(8):
        for moment in ("before", "after"):
            save_picture(root / f"grasp_{i}/touch_{moment}/left.png", i)


def _presses(root: Path) -> None:
    for name in ("press_1", "press_2"):
        for i in range(8):
            save_picture(root / f"mug/{name}/gelsight/{i}.png", i)


def _actions(root: Path) -> None:
    for name in ("press", "slide_left"):
        for i in range(8):
            save_picture(root / f"mug/{name}/gelsight/{i}.png", i)
        _forces(root / f"mug/{name}/gelsight/ft.csv")


def _tactile(root: Path) -> None:
    for name in ("trial_1", "trial_2"):
        for i in range(8):
            save_picture(root / f"tactile/mug/{name}/gelsight/{i}.png", i)


@pytest.mark.parametrize(
    "make",
    [
        *(_mov, _gelsight_avi, _touch_and_vision, _gelsight_frame, _pairs, _arrays, _episodes),
        *(_moments, _tactile, _presses, _actions),
    ],
)
def test_no_published_reader_takes_it(make: Callable[[Path], None], tmp_path: Path) -> None:
    make(tmp_path)
    assert [name for name, _ in recognise(tmp_path)] == ["recordings"]


@pytest.mark.parametrize("make", [_mov, _gelsight_avi, _touch_and_vision])
def test_its_forces_are_read(make: Callable[[Path], None], tmp_path: Path) -> None:
    make(tmp_path)
    name, guess = recognise(tmp_path)[0]
    data = registry.build("datasets", {"name": name, **guess.options, "val": 0})
    recordings = list(data.recordings("train"))
    assert len(recordings) >= 2
    for one in recordings:
        assert one.force is not None
        assert 0 < float(np.nanmax(one.force[:, 2])) <= 0.7 + 1e-6


def test_films_of_objects_in_the_size_of_a_mini_are_of_octopi(tmp_path: Path) -> None:
    for name in ("cup_0", "pen_0"):
        write_video(tmp_path / f"{name}.mov", greys(3, 7, (240, 320)), codec="mp4v")
    assert recognise(tmp_path)[0][0] == "octopi"
    assert recognise(tmp_path)[-1][0] == "recordings"
