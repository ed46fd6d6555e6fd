"""Folders of several sensors, sizes and backgrounds: a layout for each part, with no key typed."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from videos import write_video

from tactileforge.contracts import Recording
from tactileforge.datasets.recordings import Recordings
from tactileforge.errors import DataNotFoundError
from tactileforge.reading.guessing.layout import guess_layout

RNG = np.random.default_rng(0)


def image(path: Path, level: int | None = None, size: tuple[int, int] = (24, 32)) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    pixels = np.full((*size, 3), level) if level else RNG.integers(0, 256, (*size, 3))
    Image.fromarray(pixels.astype(np.uint8)).save(path)


def film(path: Path) -> None:
    write_video(path, [np.full((24, 32, 3), level, np.uint8) for level in range(60, 84)])


def read(root: Path) -> tuple[dict[str, Recording], Sequence[str]]:
    guess = guess_layout(root)
    assert guess is not None
    data = Recordings(**guess.options)
    found = {one.key: one for split in ("train", "val") for one in data.recordings(split)}
    assert not data.skipped
    return found, guess.doubts


def test_films_named_by_sensors_have_each_its_sensor_and_forces(tmp_path: Path) -> None:
    for sensor, factor in (("digit", -1), ("gelsight_mini", 2)):
        film(tmp_path / f"{sensor}_press.avi")
        rows = [f"{n},{n / 25:.4f},0.5,0,{factor * n / 10}" for n in range(24)]
        text = "video_frame,t_s,fx_n,fy_n,fz_n\n" + "\n".join(rows)
        (tmp_path / f"{sensor}_force.csv").write_text(text)
    film(tmp_path / "other-1.avi")
    found, doubts = read(tmp_path)
    sensors = {key.split("/")[1]: one.sensor for key, one in found.items()}
    assert sensors["digit_press.avi"] == "digit"
    assert sensors["gelsight_mini_press.avi"] == "gelsight_mini"
    assert len(found) == 3
    digit, mini = (found[f"{s}/{s}_press.avi"].force for s in ("digit", "gelsight_mini"))
    assert digit is not None
    assert mini is not None
    np.testing.assert_array_equal(digit[:, 2], np.arange(24, dtype=np.float32) / np.float32(10))
    np.testing.assert_array_equal(mini[:, 0], np.float32(0.5))
    np.testing.assert_allclose(mini[:, 2], np.arange(24) / 5, rtol=1e-6)
    assert "digit: force: fz_n is negative where it is large, so z is turned" in doubts


def test_images_named_by_sensors_are_read_once(tmp_path: Path) -> None:
    for n in range(4):
        for sensor in ("digit", "gelsight", "gelsight_mini"):
            image(tmp_path / f"{n}_{sensor}.png")
    found, _ = read(tmp_path)
    assert len(found) == 12
    for key, one in found.items():
        assert one.sensor == key.rpartition("/")[2].removesuffix(".png").partition("_")[2]


def test_backgrounds_are_of_their_folders_alone(tmp_path: Path) -> None:
    for folder, level in (("a", 80), ("b", 160), ("c", None)):
        for n in range(4):
            image(tmp_path / folder / f"{n}.png")
        if level:
            image(tmp_path / folder / "bg-0.png", level)
    found, _ = read(tmp_path)
    assert len(found) == 12
    levels = {
        key[0]: None if one.no_contact is None else int(one.no_contact.read([0])[0, 0, 0, 0])
        for key, one in found.items()
    }
    assert levels == {"a": 80, "b": 160, "c": None}


def test_a_background_of_another_size_is_left_out(tmp_path: Path) -> None:
    for n in range(4):
        image(tmp_path / f"press_{n}.png", size=(24, 32) if n else (48, 64))
    image(tmp_path / "background.png", 90)
    found, doubts = read(tmp_path)
    assert len(found) == 4
    assert all(one.no_contact is None for one in found.values())
    assert (
        "background: background.png is not of the size and colours of all pictures, and left out"
        in doubts
    )


def test_a_picture_of_something_else_is_no_background(tmp_path: Path) -> None:
    for n in range(4):
        image(tmp_path / f"press_{n}.png", 40 + n)
    image(tmp_path / "pseudo_bg.png", 140)
    found, doubts = read(tmp_path)
    assert all(one.no_contact is None for one in found.values())
    assert "background: pseudo_bg.png is not of the size and colours" in "".join(doubts)


def test_a_press_that_begins_late_is_one_recording(tmp_path: Path) -> None:
    base = RNG.integers(60, 120, (48, 64, 3))
    for n in range(60):
        noise = RNG.integers(-3, 4, base.shape)
        pressed = base + noise
        pressed[10:40, 10:50] += max(0, n - 25) * 3
        (tmp_path / "take").mkdir(exist_ok=True)
        pixels = pressed.clip(0, 255).astype(np.uint8)
        Image.fromarray(pixels).save(tmp_path / "take" / f"{n:03d}.png")
    found, _ = read(tmp_path)
    assert [len(one.frames) for one in found.values()] == [60]


def test_a_type_of_sensor_without_a_package_is_said(tmp_path: Path) -> None:
    for n in range(4):
        image(tmp_path / "wedge_presses" / f"{n}.png", size=(32, 24))
    found, doubts = read(tmp_path)
    assert {one.sensor for one in found.values()} == {"gelsight"}
    assert "sensor: wedge by its name, which no package has" in "".join(doubts)


def test_forces_of_both_sides_in_one_table(tmp_path: Path) -> None:
    """Each side has its columns, and both of a trial are held out together."""
    for k in range(4):
        for side in ("left", "right"):
            for n in range(8):
                image(tmp_path / f"trial_{k}/{side}/{n:03d}.png", 60 + 5 * n + k)
        names = [f"{side}_f{axis}" for side in ("left", "right") for axis in "xyz"]
        header = ",".join(["frame", *names])
        rows = [f"{n},0,0,{n / 4},0,0,{n}" for n in range(8)]
        (tmp_path / f"trial_{k}/forces.csv").write_text("\n".join([header, *rows]) + "\n")
    guess = Recordings.recognise(tmp_path)
    assert guess is not None
    data = Recordings(**guess.options)
    held = {one.key for one in data.recordings("val")}
    found = {one.key: one for one in (*data.recordings("train"), *data.recordings("val"))}
    assert len(found) == 8
    for key, one in found.items():
        assert one.force is not None
        factor = 0.25 if key.startswith("left/") else 1.0
        np.testing.assert_allclose(one.force[:, 2], factor * np.arange(8), atol=1e-6)
    assert {key.split("/")[0] for key in held} == {"left", "right"}
    assert len({key.split("/")[1] for key in held}) == 1


def test_a_table_is_of_the_sensor_in_its_name(tmp_path: Path) -> None:
    for k in range(3):
        for sensor in ("digit", "gelsight_mini"):
            for n in range(8):
                image(tmp_path / f"grasp_{k}/{sensor}/{n:03d}.png", 60 + 5 * n + k)
        rows = [f"{n},0,0,{n}" for n in range(8)]
        table = tmp_path / f"grasp_{k}/digit_force.csv"
        table.write_text("\n".join(["frame,fx,fy,fz", *rows]) + "\n")
    guess = Recordings.recognise(tmp_path)
    assert guess is not None
    data = Recordings(**guess.options)
    found = [*data.recordings("train"), *data.recordings("val")]
    assert {(one.sensor, one.force is not None) for one in found} == {
        ("digit", True),
        ("gelsight_mini", False),
    }


def table(path: Path, peak: int) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    rows = [f"{n / 25:.4f},0,0,{peak * n / 23:.6f}" for n in range(24)]
    path.write_text("\n".join(["t,fx,fy,fz", *rows]) + "\n")


def test_tables_in_sibling_folders_are_each_of_their_own_trial(tmp_path: Path) -> None:
    for number in range(3):
        film(tmp_path / f"trial_{number}/video/data.avi")
        table(tmp_path / f"trial_{number}/ft/data.csv", 2 + number)
    found, _ = read(tmp_path)
    assert len(found) == 3
    for key, one in found.items():
        assert one.force is not None
        assert one.force[-1, 2] == 2 + int(key.split("/")[1][-1])


def test_the_table_of_one_trial_is_not_given_to_others(tmp_path: Path) -> None:
    for day in "ab":
        for number in range(2):
            film(tmp_path / f"day_{day}/trial_{number}/video/data.avi")
    for number in range(2):
        table(tmp_path / f"day_a/trial_{number}/ft/data.csv", 2)
    found, doubts = read(tmp_path)
    assert len(found) == 4
    assert all(one.force is None for one in found.values())
    line = "force: not every recording has its {above}/../ft/{stem}.csv; left out"
    assert line in doubts


def test_very_deep_trees_have_each_their_own_table(tmp_path: Path) -> None:
    """Thirty folders deep, where comparing every choice of folders would not end."""
    for number in range(2):
        below = tmp_path / f"trial_{number}" / "/".join(f"level_{depth}" for depth in range(30))
        film(below / "touch.avi")
        table(below / "touch.csv", 2 + number)
    found, _ = read(tmp_path)
    peaks = [one.force[-1, 2] for _, one in sorted(found.items()) if one.force is not None]
    assert peaks == [2, 3]


@pytest.mark.parametrize("below", ["", "/day_1"])
def test_tables_in_a_tree_like_that_of_the_films_are_each_of_their_own(
    below: str, tmp_path: Path
) -> None:
    for number, item in enumerate(("mug", "can")):
        for trial in range(2):
            film(tmp_path / f"video/{item}{below}/trial_{trial}.avi")
            table(tmp_path / f"ft/{item}{below}/trial_{trial}.csv", 2 + 2 * number + trial)
    found, _ = read(tmp_path)
    peaks = {one.key: one.force[-1, 2] for one in found.values() if one.force is not None}
    assert peaks == {
        f"guessed/video/{item}{below}/trial_{trial}.avi": 2 + 2 * number + trial
        for number, item in enumerate(("mug", "can"))
        for trial in range(2)
    }


def test_the_table_of_one_object_is_not_given_to_others(tmp_path: Path) -> None:
    for item in ("mug", "can"):
        for trial in range(2):
            film(tmp_path / f"video/{item}/trial_{trial}.avi")
    for trial in range(2):
        table(tmp_path / f"ft/mug/raw/trial_{trial}.csv", 2)
    found, doubts = read(tmp_path)
    assert len(found) == 4
    assert all(one.force is None for one in found.values())
    assert "force: not every recording has its ft/{folder}/raw/{stem}.csv; left out" in doubts


@pytest.mark.parametrize(
    ("video", "ft"),
    [
        ("raw/video/{item}/trial_{trial}", "ft/{item}/trial_{trial}"),
        ("video/{item}/trial_{trial}", "data/raw/ft/{item}/trial_{trial}"),
        ("{item}/tactile/{trial}", "{item}/force/{trial}"),
        ("videos/{item}_{trial}_video", "forces/{item}_{trial}_force"),
        ("videos/video_{item}{trial}", "forces/force_{item}{trial}"),
        ("{item}/trial_{trial}", "{item}/ft_trial_{trial}"),
    ],
)
def test_a_table_is_of_the_recording_with_most_of_its_path(
    video: str, ft: str, tmp_path: Path
) -> None:
    peaks = {}
    for number in range(4):
        names = {"item": ("mug", "can")[number // 2], "trial": number % 2}
        path = f"{video}.avi".format(**names)
        film(tmp_path / path)
        table(tmp_path / f"{ft}.csv".format(**names), 2 + number)
        peaks[f"guessed/{path}"] = 2 + number
    found, _ = read(tmp_path)
    assert peaks == {one.key: one.force[-1, 2] for one in found.values() if one.force is not None}


@pytest.mark.parametrize(
    ("video", "ft"),
    [("tactile", "ft/ft"), ("tactile", "ft"), ("video/gel", "ft"), ("video/gel", "ft/gel")],
)
def test_tables_of_recordings_below_many_folders_are_each_of_their_own(
    video: str, ft: str, tmp_path: Path
) -> None:
    peaks = {}
    for number in range(8):
        user, item, trial = number // 4, number // 2 % 2, number % 2
        folder = f"lab/user_{user}/item_{item}/trial_{trial}"
        film(tmp_path / folder / f"{video}.avi")
        table(tmp_path / folder / f"{ft}.csv", 2 + number)
        peaks[f"guessed/{folder}/{video}.avi"] = 2 + number
    found, _ = read(tmp_path)
    assert peaks == {one.key: one.force[-1, 2] for one in found.values() if one.force is not None}


def counted(folder: Path, frames: int, first: int = 0, rows: int = 20) -> None:
    """Images of a moving gel, with numbers in their names, and a table with a row of each."""
    for number in range(frames):
        image(folder / f"{number + first:04d}.png", 60 + 8 * number)
    if rows:
        lines = [f"{first + n},0,0,{n}" for n in range(rows)]
        (folder / "ft.csv").write_text("\n".join(["frame,fx,fy,fz", *lines]) + "\n")


@pytest.mark.parametrize("first", [0, 1, 100])
def test_forces_after_the_last_frame_stop_nothing(first: int, tmp_path: Path) -> None:
    for number in range(3):
        counted(tmp_path / f"trial_{number}", 20 - number, first)
    found, doubts = read(tmp_path)
    assert sorted(len(one.frames) for one in found.values()) == [18, 19, 20]
    for one in found.values():
        assert one.force is not None
        np.testing.assert_array_equal(one.force[:, 2], np.arange(len(one.frames)))
    assert any("goes on after the last frame of trial_1 and 1 more" in line for line in doubts)


def test_a_trial_without_its_table_has_no_force_and_is_named(tmp_path: Path) -> None:
    for number in range(3):
        counted(tmp_path / f"trial_{number}", 20, rows=0 if number == 2 else 20)
    found, doubts = read(tmp_path)
    has_force = {key.rpartition("/")[2]: one.force is not None for key, one in found.items()}
    assert has_force == {"trial_0": True, "trial_1": True, "trial_2": False}
    assert all((one.action is not None) == (one.force is not None) for one in found.values())
    assert any("trial_2 without {file}/ft.csv" in line for line in doubts)


def test_a_table_of_no_recording_is_missing_all_the_same(tmp_path: Path) -> None:
    counted(tmp_path / "trial_0", 20)
    layout = {
        "images": "*/*.png",
        "each": "sequence",
        "fps": 30,
        "sensor": "digit",
        "background": "none",
        "force": {"file": "{file}/no.csv", "columns": ["fx", "fy", "fz"], "partial": True},
    }
    data = Recordings(root=str(tmp_path), layouts={"own": layout})
    with pytest.raises(DataNotFoundError, match=r"no\.csv: no such CSV"):
        list(data.recordings("train"))


def test_arrays_named_by_splits_are_held_out_so_with_their_own_forces(tmp_path: Path) -> None:
    for split, level in (("train", 3), ("test", 5)):
        np.save(tmp_path / f"frames_{split}.npy", np.full((20, 24, 32, 3), level, np.uint8))
        np.save(tmp_path / f"forces_{split}.npy", np.full((20, 3), level, np.float32))
    guess = guess_layout(tmp_path)
    assert guess is not None
    data = Recordings(**guess.options)
    for split, level in (("train", 3), ("val", 5)):
        [one] = data.recordings(split)
        assert one.frames.read([0]).max() == level
        assert one.force is not None
        np.testing.assert_array_equal(one.force, np.full((20, 3), level))


def test_a_toy_train_among_others_is_no_split(tmp_path: Path) -> None:
    for name in ("toy_train_1", "toy_train_2", "toy_car_1", "toy_car_2"):
        film(tmp_path / f"{name}.avi")
    found, _ = read(tmp_path)
    assert len({key.split("/")[0] for key in found}) == 1


def test_the_view_of_a_scene_may_be_an_array(tmp_path: Path) -> None:
    for number in range(2):
        folder = tmp_path / f"trial_{number}"
        folder.mkdir()
        np.save(folder / "qpos.npy", np.zeros((20, 7)))
        np.save(folder / "rgb.npy", np.full((20, 24, 32, 3), 90 + number, np.uint8))
        for side in ("left", "right"):
            np.save(folder / f"tactile_{side}.npy", RNG.integers(0, 255, (20, 24, 32, 3), np.uint8))
    found, _ = read(tmp_path)
    assert len(found) == 4
    for key, one in found.items():
        assert one.image is not None
        assert one.image.read([3]).max() == 90 + int(key.split("/")[1][-1])


def test_sides_within_names_of_folders_have_each_its_forces(tmp_path: Path) -> None:
    for k in range(2):
        for side, factor in (("left", 1), ("right", 2)):
            for n in range(6):
                image(tmp_path / f"trial_{k}/{side}_tactile/{n}.png", 60 + n)
            rows = [f"{n},0,0,{factor * n}" for n in range(6)]
            text = "frame,fx,fy,fz\n" + "\n".join(rows)
            (tmp_path / f"trial_{k}/{side}_ft.csv").write_text(text)
    found, _ = read(tmp_path)
    assert len(found) == 4
    for key, one in found.items():
        assert one.force is not None
        factor = 2 if "right" in key else 1
        np.testing.assert_array_equal(one.force[:, 2], factor * np.arange(6, dtype=np.float32))


def test_objects_with_words_of_sides_are_no_sides(tmp_path: Path) -> None:
    for name in ("top_cap", "bottom_cap"):
        for k in range(2):
            film(tmp_path / f"{name}/{k}.avi")
            (tmp_path / f"{name}/{k}.csv").write_text(
                "frame,fx,fy,fz\n" + "\n".join(f"{n},0,0,{n}" for n in range(24))
            )
    found, _ = read(tmp_path)
    assert {key: one.object for key, one in found.items()} == {
        f"guessed/{name}/{k}.avi": name for name in ("top_cap", "bottom_cap") for k in range(2)
    }


@pytest.mark.parametrize("below", ["run1/frames", "press_01/frames", "2024-05-13/run1", "test 3/x"])
def test_the_object_is_above_a_trial_or_a_date(below: str, tmp_path: Path) -> None:
    for name in ("mug", "can"):
        for n in range(6):
            image(tmp_path / name / below / f"{n}.png", 60 + n)
    found, doubts = read(tmp_path)
    wanted = {f"guessed/{name}/{below}": name for name in ("mug", "can")}
    assert {key: one.object for key, one in found.items()} == wanted
    assert any(line.startswith("object: named by the folder above") for line in doubts)


@pytest.mark.parametrize("names", [("slip", "stable"), ("success", "failure"), ("good", "bad")])
def test_outcomes_are_no_objects(names: tuple[str, str], tmp_path: Path) -> None:
    for name in names:
        for k in range(2):
            film(tmp_path / f"{name}/{k}.avi")
    found, doubts = read(tmp_path)
    assert {one.object for one in found.values()} == {None}
    assert [line.partition(",")[0] for line in doubts if line.startswith("object:")] == [
        f"object: folders are named by what came of it ({min(names)}"
    ]


def test_an_object_with_the_word_of_an_outcome_is_one(tmp_path: Path) -> None:
    for name in ("drop", "mug"):
        for k in range(2):
            film(tmp_path / f"{name}/{k}.avi")
    found, _ = read(tmp_path)
    assert {one.object for one in found.values()} == {"drop", "mug"}


@pytest.mark.parametrize("of_all", [False, True])
def test_fingers_have_each_its_sensor_by_a_file_of_values(of_all: bool, tmp_path: Path) -> None:
    text = '{"sensors": {"thumb": "DIGIT", "index": "GelSight Mini"}, "object": "mug"}'
    for k in range(2):
        film(tmp_path / f"ep_{k}/thumb.avi")
        film(tmp_path / f"ep_{k}/index.avi")
        (tmp_path / ("" if of_all else f"ep_{k}") / "meta.json").write_text(text)
    found, _ = read(tmp_path)
    wanted = {"thumb": "digit", "index": "gelsight_mini"}
    assert {key: (one.sensor, one.object) for key, one in found.items()} == {
        f"{side}/ep_{k}/{side}.avi": (sensor, "mug")
        for side, sensor in wanted.items()
        for k in (0, 1)
    }
