"""Views of a scene beside touch, and words as labs write them: no key typed."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml

from tactileforge.contracts import Recording
from tactileforge.datasets.recordings import Recordings
from tactileforge.errors import DataError
from tactileforge.reading.guessing.sensor_names import guess_sensor, named_sensor
from tactileforge.reading.guessing.view_words import scenes

COUNT = 10
FORCE = np.linspace(0, 2, COUNT)


def video(path: Path, grey: int = 60) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 20, (64, 48))
    for n in range(COUNT):
        writer.write(np.full((48, 64, 3), grey + n, np.uint8))
    writer.release()


def images(folder: Path, grey: int = 60) -> None:
    folder.mkdir(parents=True)
    for n in range(COUNT):
        cv2.imwrite(str(folder / f"{n:03d}.png"), np.full((48, 64, 3), grey + n, np.uint8))


def read(root: Path) -> tuple[dict[str, Recording], list[str]]:
    guess = Recordings.recognise(root)
    assert guess is not None
    data = Recordings(**guess.options)
    found = [one for split in ("train", "val") for one in data.recordings(split)]
    assert not data.skipped
    return {one.key.partition("/")[2]: one for one in found}, guess.doubts


def forces(path: Path, header: str, times: list[str], axes: int = 3) -> None:
    rows = [[time, *["0"] * (axes - 1), f"{z:.4f}"] for time, z in zip(times, FORCE, strict=True)]
    path.write_text("\n".join([header, *map(",".join, rows)]) + "\n")


def check(one: Recording, factor: float = 1.0) -> None:
    assert one.force is not None
    np.testing.assert_allclose(one.force[:, 2], factor * FORCE, atol=1e-4 * max(1, factor))


def test_a_film_of_the_scene_is_the_camera_of_touch(tmp_path: Path) -> None:
    for k in range(3):
        video(tmp_path / f"Trial{k}/TactileVideo.avi")
        video(tmp_path / f"Trial{k}/WebcamVideo.avi", 200)
        times = [f"{n / 20}" for n in range(COUNT)]
        forces(tmp_path / f"Trial{k}/ForceTorqueData.csv", "TimeSec,ForceX,ForceY,ForceZ", times)
    found, doubts = read(tmp_path)
    assert sorted(found) == [f"Trial{k}/TactileVideo.avi" for k in range(3)]
    for one in found.values():
        assert one.image is not None
        assert one.image.read([0]).mean() > 190 > one.frames.read([0]).mean()
        check(one)
    assert "camera: {folder}/WebcamVideo.avi is the view of the scene" in doubts


@pytest.mark.parametrize("days", [[""], ["mon/", "tue/"]])
@pytest.mark.parametrize(
    ("touch", "view"),
    [
        ("touch/trial_{}", "vision/trial_{}"),
        ("touch/trial_{}", "vision/trial_{}/rgb"),
        ("touch/trial_{}", "camera/trial_{}.avi"),
        ("touch/trial_{}/film.avi", "camera/trial_{}/film.avi"),
        ("touch/trial_{}.avi", "camera/trial_{}/a.avi"),
    ],
)
@pytest.mark.parametrize("table", ["ft/trial_{}.csv", "ft/trial_{}/data.csv"])
def test_trees_of_touch_views_and_forces_belong_together(
    touch: str, view: str, table: str, days: list[str], tmp_path: Path
) -> None:
    if touch.count("/") > 1:
        days = [""]  # a folder above that of the trial's has no column
    takes = [(day, k) for day in days for k in range(3)]
    for day, k in takes:
        for name, grey in ((touch, 40), (view, 140)):
            make = video if name.endswith(".avi") else images
            make(tmp_path / day / name.format(k), grey + 20 * k)
        path = tmp_path / day / table.format(k)
        path.parent.mkdir(parents=True, exist_ok=True)
        rows = [f"{n},0,0,{(k + 1) * FORCE[n]:.4f}" for n in range(COUNT)]
        path.write_text("\n".join(["frame,fx,fy,fz", *rows]) + "\n")
    found, _ = read(tmp_path)
    assert sorted(found) == sorted(day + touch.format(k) for day, k in takes)
    for day, k in takes:
        one = found[day + touch.format(k)]
        assert one.image is not None
        assert abs(one.image.read([0]).mean() - (140 + 20 * k)) < 3
        check(one, k + 1)


def test_folders_of_views_and_depth_are_no_touch(tmp_path: Path) -> None:
    for k in range(3):
        for name in ("tactile_left", "tactile_right", "tactile_left_depth", "realsense"):
            images(tmp_path / f"pick_{k}" / name, 200 if name == "realsense" else 60)
    found, doubts = read(tmp_path)
    sides = ("tactile_left", "tactile_right")
    assert sorted(found) == [f"pick_{k}/{side}" for k in range(3) for side in sides]
    assert all(one.image is not None and one.image.read([0]).mean() > 190 for one in found.values())
    assert any("tactile_left_depth/*.png left out" in line for line in doubts)


def test_images_of_touch_beside_a_film_of_the_scene(tmp_path: Path) -> None:
    for k in range(3):
        images(tmp_path / f"trial{k}/gelsight")
        video(tmp_path / f"trial{k}/webcam.avi", 200)
    found, _ = read(tmp_path)
    assert sorted(found) == [f"trial{k}/gelsight" for k in range(3)]
    assert all(one.image is not None for one in found.values())


@pytest.mark.parametrize(
    ("names", "left"),
    [
        (["cup", "gel_bottle", "camera"], []),  # objects
        (["left", "right"], []),
        (["rgb", "depth"], ["depth"]),
        (["left", "webcam"], ["webcam"]),
        (["webcam"], []),
        (["digit", "color"], ["color"]),
        (["gelsight", "gelsight_flow"], ["gelsight_flow"]),
        (["gelsight", "gelsight_markers"], []),
        (["tactile_front", "tactile_top"], []),
    ],
)
def test_what_is_a_view_by_its_name(names: list[str], left: list[str]) -> None:
    paths = [Path(f"t{k}/{name}/{n}.png") for k in range(2) for name in names for n in range(2)]
    assert {path.parts[1] for path in scenes(paths, Path())} == {*left}


@pytest.mark.parametrize(
    ("written", "sensor"),
    [
        ("GelSightMini_2", "gelsight_mini"),
        ("GelSight Mini", "gelsight_mini"),
        ("gs-mini", "gelsight_mini"),
        ("DIGIT_D20123", "digit"),
        ("GelSight-R1.5", "gelsight"),
        ("minigame", ""),
    ],
)
def test_sensors_as_they_are_written(written: str, sensor: str) -> None:
    assert named_sensor(written) == sensor


@pytest.mark.parametrize(
    ("words", "sensor", "said"),
    [
        ("digital_twin", "gelsight_mini", "no name tells the type"),
        ("prestidigitation/admin/dmitri", "gelsight_mini", "no name tells the type"),
        ("digitized_mug", "gelsight_mini", "no name tells the type"),
        ("Digit360", "digit", "digit360 by its name, which no package has; digit is the nearest"),
        ("digit360_2/GelSight360", "gelsight", "gelsight360 by its name, which no package has"),
        ("digits", "digit", "by the word digits"),
        ("hand_digit_0", "digit", ""),
        ("DM-Tac", "dm", ""),
        ("DMTac_W", "dm", ""),
        ("GelSightR1.5", "gelsight", ""),
        ("leftgelsight", "gelsight", ""),
    ],
)
def test_words_that_hold_the_name_of_a_sensor(words: str, sensor: str, said: str) -> None:
    doubts: list[str] = []
    assert guess_sensor(words, lambda: (40, 60), doubts) == {"sensor": sensor}
    assert len(doubts) == bool(said)
    assert all(said in line for line in doubts)


def test_the_sensor_in_a_file_of_nested_keys(tmp_path: Path) -> None:
    about = {"sensor": {"type": "DIGIT", "serial": "D20123"}, "camera": {"fps": 25}}
    for k in range(2):
        images(tmp_path / f"a/trial_{k}")
        images(tmp_path / f"b/trial_{k}")
        (tmp_path / f"b/trial_{k}/about.yaml").write_text(yaml.safe_dump(about))
    (tmp_path / "a/config.yaml").write_text(yaml.safe_dump(about))
    for root in "ab":
        found, doubts = read(tmp_path / root)
        assert {one.sensor for one in found.values()} == {"digit"}
        assert not any("no name tells the type" in line for line in doubts)


def test_sensors_of_folders_and_files_beside(tmp_path: Path) -> None:
    for name in ("DIGIT_D20123", "GelSightMini_2"):
        images(tmp_path / "a" / name / "0")
    found, _ = read(tmp_path / "a")
    assert {key.split("/")[0]: one.sensor for key, one in found.items()} == {
        "DIGIT_D20123": "digit",
        "GelSightMini_2": "gelsight_mini",
    }
    for k, name in enumerate(("mug", "pen")):
        video(tmp_path / f"b/take{k}/film.avi")
        about = {"object": name, "sensor": "DIGIT", "timestamps": [n / 20 for n in range(COUNT)]}
        about |= {"forces": [[0.0, 0.0, z] for z in FORCE]}
        (tmp_path / f"b/take{k}/data.json").write_text(json.dumps(about))
    found, _ = read(tmp_path / "b")
    for k, name in enumerate(("mug", "pen")):
        one = found[f"take{k}/film.avi"]
        assert (one.object, one.sensor) == (name, "digit")
        check(one)


@pytest.mark.parametrize(
    "times",
    [
        [f"2024-10-27T23:59:59.{50 + 5 * n}" for n in range(COUNT)],
        [f"23:59:59.{50 + 5 * n}" for n in range(COUNT)],
        [*(f"23:59:59.{n}" for n in range(5, 10)), *(f"0:00:00.{n}" for n in range(5))],
    ],
)
def test_dates_and_times_of_day(tmp_path: Path, times: list[str]) -> None:
    for k in range(2):
        images(tmp_path / f"rec{k}/frames")
        forces(tmp_path / f"rec{k}/log.csv", "time,Fx [N],Fy [N],Fz [N]", times)
    found, _ = read(tmp_path)
    for one in found.values():
        assert one.times[-1] == pytest.approx(0.9 if "0:00" in times[-1] else 0.45, abs=1e-6)
        check(one)


@pytest.mark.parametrize(
    ("file", "header", "factor"),
    [
        ("force_kgf.csv", "frame,fx,fy,fz", 9.80665),
        ("run_g.csv", "frame,fx,fy,fz", 1.0),
        ("log.csv", "frame,ati_fx,ati_fy,ati_fz", 1.0),
        ("loads.csv", "Frame,NormalForce [mN]", 1e-3),
    ],
)
def test_units_and_sensors_in_names(tmp_path: Path, file: str, header: str, factor: float) -> None:
    for k in range(2):
        images(tmp_path / f"{k}/cam")
        axes = len(header.split(",")) - 1
        forces(tmp_path / f"{k}/{file}", header, [str(n) for n in range(COUNT)], axes)
    for one in read(tmp_path)[0].values():
        check(one, factor)


@pytest.mark.parametrize(
    ("header", "factor", "axes"),
    [
        ("time,force", 1, 1),
        ("t,load_N", 1, 1),
        ("timestamp,weight_g", 0.00980665, 1),
        ("frame,Fn", 1, 1),
        ("Zeit [s],Kraft X [N],Kraft Y [N],Kraft Z [N]", 1, 3),
        ("time,Fuerza_x,Fuerza_y,Fuerza_z", 1, 3),
        ("time,sensor_x[mN],sensor_y[mN],sensor_z[mN]", 0.001, 3),
    ],
)
def test_forces_as_they_are_called(header: str, factor: float, axes: int, tmp_path: Path) -> None:
    for k in range(3):
        images(tmp_path / f"take_{k}/digit")
        # a table with gaps elsewhere writes its frame numbers as 1.0
        times = [f"{n}.0" if header.startswith("frame") else f"{n / 20}" for n in range(COUNT)]
        forces(tmp_path / f"take_{k}/data.csv", header, times, axes)
    found, doubts = read(tmp_path)
    assert len(found) == 3
    for one in found.values():
        check(one, factor)
        assert one.force is not None
        assert np.isnan(one.force[:, :2]).all() == (axes == 1)
    assert any("for the normal one" in line for line in doubts) == (axes == 1)


@pytest.mark.parametrize(
    ("header", "said"),
    [
        ("time,F1,F2,F3", "force: F1, F2, F3 of {folder}/data.csv say no axis, and are not read"),
        ("time,cpu_load,weight,note", ""),
        ("time,grip_N,b,c", "force: grip_N of {folder}/data.csv say no axis"),
    ],
)
def test_numbers_that_are_no_force_by_their_names_are_told_and_left(
    header: str, said: str, tmp_path: Path
) -> None:
    for k in range(3):
        images(tmp_path / f"take_{k}/digit")
        times = [f"{n / 20}" for n in range(COUNT)]
        forces(tmp_path / f"take_{k}/data.csv", header, times)
    found, doubts = read(tmp_path)
    assert all(one.force is None for one in found.values())
    assert any(line.startswith(said) for line in doubts)
    assert said or not any(line.startswith("force") for line in doubts)


def test_forces_of_a_robot_or_of_several_are_told_and_left(tmp_path: Path) -> None:
    for k, header in enumerate(("frame,ee_fx,ee_fy,ee_fz", "frame,left_fz,up_fz,right_fz")):
        images(tmp_path / f"{k}/0/cam")
        forces(tmp_path / f"{k}/0/log.csv", header, [str(n) for n in range(COUNT)])
        found, doubts = read(tmp_path / str(k))
        assert all(one.force is None for one in found.values())
        assert any(line.startswith("force: ") and "left out" in line for line in doubts)


def test_labels_of_a_series_are_those_of_all_its_rows(tmp_path: Path) -> None:
    for k, slips in enumerate((0, 1)):  # in the second one the label changes
        images(tmp_path / f"{k}/cam")
        rows = [f"{n},{z:.4f},{int(n > 5) * slips},cup{k}" for n, z in enumerate(FORCE)]
        (tmp_path / f"{k}/log.csv").write_text("\n".join(["frame,fz,label,item", *rows]) + "\n")
    # the label changes in one of them
    assert {one.object for one in read(tmp_path)[0].values()} == {"cup0", "cup1"}
    layout = "{images: '*/cam/*.png', each: sequence, fps: 20, sensor: digit, background: none, "
    layout += "labels: {file: '{folder}/log.csv'}, object: '{item}'}"
    data = Recordings(str(tmp_path), layouts={"mine": yaml.safe_load(layout)})
    read_again = [one for split in ("train", "val") for one in data.recordings(split)]
    assert {one.object for one in read_again} == {"cup0", "cup1"}
    layout = layout.replace("{item}", "{label}")  # asked for, it is an error
    data = Recordings(str(tmp_path), layouts={"mine": yaml.safe_load(layout)}, val=0)
    with pytest.raises(DataError, match="label is '1' here and '0' in"):
        list(data.recordings("train"))


def test_a_damaged_film_tells_no_sensor(tmp_path: Path) -> None:
    (tmp_path / "a.avi").write_bytes(b"cut off")
    (doubt,) = (line for line in Recordings.recognise(tmp_path).doubts if "sensor" in line)
    assert "stands in, as no picture can be read" in doubt
    video(tmp_path / "b.avi")
    (doubt,) = (line for line in Recordings.recognise(tmp_path).doubts if "sensor" in line)
    assert "only by the shape 48 x 64" in doubt


def test_objects_by_the_folders_of_their_recordings(tmp_path: Path) -> None:
    for name in ("Holz", "Metall"):
        for k in range(2):
            video(tmp_path / "a" / name / f"{k}.avi")
    assert {one.object for one in read(tmp_path / "a")[0].values()} == {"Holz", "Metall"}
    for k in range(2):  # trials, sides
        for side in ("left", "right"):
            video(tmp_path / f"b/cup_{'ab'[k]}/{side}.avi")
        for n in range(2):
            video(tmp_path / f"c/session{'AB'[k]}/{n}.avi")
    for folder in ("b", "c"):
        assert {one.object for one in read(tmp_path / folder)[0].values()} == {None}


def test_the_number_of_an_object_is_its_name_where_no_column_has_that(tmp_path: Path) -> None:
    for folder, header in (("a", "file,object_id,mass"), ("b", "file,object_id,object_name")):
        for k in range(3):
            video(tmp_path / folder / f"{k}.avi")
        rows = [header, *(f"{k}.avi,{k + 4},{'mug' if folder == 'b' else 7}" for k in range(3))]
        (tmp_path / folder / "about.csv").write_text("\n".join(rows) + "\n")
    found = {name: [one.object for one in read(tmp_path / name)[0].values()] for name in "ab"}
    assert {name: sorted(map(str, told)) for name, told in found.items()} == {
        "a": ["4", "5", "6"],
        "b": ["mug"] * 3,
    }


@pytest.mark.parametrize("column", ["Objekt", "phase", "field.header.frame_id", "object"])
def test_words_in_a_table_of_forces_that_are_not_read_are_told(column: str, tmp_path: Path) -> None:
    for k in range(2):
        video(tmp_path / f"{k}.avi")
        rows = [f"t,{column},Fx,Fy,Fz,T", *(f"{n / 20},Tasse,0,0,{n},20.5" for n in range(COUNT))]
        (tmp_path / f"{k}.csv").write_text("\n".join(rows) + "\n")
    found, doubts = read(tmp_path)
    told = [line for line in doubts if "not read" in line]
    objects = {one.object for one in found.values()}
    if column in ("Objekt", "phase"):
        (line,) = told
        assert line.startswith(f"labels: {column} of {{stem}}.csv are not read; ")
        assert "'{" + column + "}'" in line
        assert objects == {None}
    else:
        assert told == []
        assert objects == ({"Tasse"} if column == "object" else {None})


@pytest.mark.parametrize(
    ("name", "told"),
    [
        ("img_{n:04d}_Fz-{z:.2f}N.png", "(fz-0.00n, fz-0.90n)"),
        ("{n:04d}_force_{z:.1f}.png", "(force_0.0, force_0.9)"),
        ("{n}_{n}N.png", "(0n, 9n)"),
        ("f{n}.png", ""),
        ("f_{n:04d}_1.5N.png", ""),
        ("{n:04d}_10{n}nm.png", ""),
    ],
)
def test_forces_in_names_are_told(name: str, told: str, tmp_path: Path) -> None:
    for n in range(COUNT):
        picture = np.full((48, 64, 3), 60 + n, np.uint8)
        cv2.imwrite(str(tmp_path / name.format(n=n, z=0.1 * n)), picture)
    lines = [line for line in read(tmp_path)[1] if line.startswith("force:")]
    assert len(lines) == bool(told)
    assert all(f"force: names of files say it {told}, and it is not read" in line for line in lines)


def test_one_table_of_paths_of_another_machine_for_two_splits(tmp_path: Path) -> None:
    rows = ["img_path,normal_force,material"]
    for part, number in (("train", 0), ("train", 1), ("test", 2)):
        images(tmp_path / part / f"take{number}", 40 + 60 * number)
        at = f"/home/li/data/{part}/take{number}"
        rows += [f"{at}/{n:03d}.png,{number + n / 10},m{number}" for n in range(COUNT)]
    (tmp_path / "all.csv").write_text("\n".join(rows) + "\n")
    found, _ = read(tmp_path)
    assert len(found) == 3
    for name, one in found.items():
        number = int(name[-1])
        assert one.object == f"m{number}"
        assert one.force is not None
        np.testing.assert_allclose(one.force[:, 2], number + np.arange(COUNT) / 10, atol=1e-5)
    table = tmp_path / "all.csv"
    table.write_text(table.read_text().replace("/home/li/data/train/take1/", "/home/li/tes/", 1))
    with pytest.raises(DataError, match=r"'/home/li/tes/000\.png' names no"):
        read(tmp_path)


@pytest.mark.parametrize(
    ("column", "is_force", "told"),
    [("weight", False, ""), ("weight [g]", True, ""), ("grip [N]", False, "grip [N]")],
)
def test_a_weight_needs_a_unit_and_a_unit_a_word(
    column: str, is_force: bool, told: str, tmp_path: Path
) -> None:
    for k in range(2):
        video(tmp_path / f"{k}.avi")
        forces(tmp_path / f"{k}.csv", f"t,{column}", [f"{n / 20}" for n in range(COUNT)], 1)
    found, doubts = read(tmp_path)
    assert {one.force is not None for one in found.values()} == {is_force}
    assert any(line.startswith(f"force: {told} of") for line in doubts) == bool(told)


def test_both_sides_in_one_table_beside_a_film_of_each(tmp_path: Path) -> None:
    for k in range(3):
        for side in ("left", "right"):
            video(tmp_path / f"trial_{k}/{side}.avi")
        rows = [f"{n / 20},9,{z:.4f},{2 * z:.4f}" for n, z in enumerate(FORCE)]
        (tmp_path / f"trial_{k}/ft.csv").write_text("\n".join(["t,fz_cmd,fz_l,fz_r", *rows]) + "\n")
    found, doubts = read(tmp_path)
    assert len(found) == 6
    for name, one in found.items():
        check(one, 1 if name.endswith("left.avi") else 2)
    assert (
        "left: force: fz_l and no other column of {folder}/ft.csv is taken for that on the gel: "
        "fz_cmd, fz_r are left out"
    ) in doubts


@pytest.mark.parametrize("film", ["demo.avi", "shown/clip_0.avi"])
def test_images_with_tables_are_read_beside_a_film_without(film: str, tmp_path: Path) -> None:
    for k in range(3):
        images(tmp_path / f"trials/trial_{k}")
        forces(tmp_path / f"trials/trial_{k}/ft.csv", "frame,fx,fy,fz", [*map(str, range(COUNT))])
    video(tmp_path / film, 200)
    found, doubts = read(tmp_path)
    assert sorted(found) == [f"trials/trial_{k}" for k in range(3)]
    for one in found.values():
        check(one)
    (line,) = (line for line in doubts if film in line)
    pasted = yaml.safe_load(line.partition("data.layouts=")[2])
    data = Recordings(root=str(tmp_path), layouts=pasted)
    assert [one.key for one in data.recordings("train")] == [f"films/{film}"]


def test_films_with_tables_are_read_beside_images_without(tmp_path: Path) -> None:
    (tmp_path / "ft").mkdir()
    for k in range(3):
        video(tmp_path / f"films/trial_{k}.avi")
        images(tmp_path / f"frames/trial_{k}")
        forces(tmp_path / f"ft/trial_{k}.csv", "t,fx,fy,fz", [f"{n / 20}" for n in range(COUNT)])
    images(tmp_path / "chessboard")
    (tmp_path / "chessboard/points.csv").write_text("a,b\n1,2\n")
    found, _ = read(tmp_path)
    assert sorted(found) == [f"films/trial_{k}.avi" for k in range(3)]


@pytest.mark.parametrize("film", ["phone/IMG_4321.avi", "GX010123.avi", "VID_20240513_101500.avi"])
def test_a_film_with_the_name_of_a_phone_is_not_touch(film: str, tmp_path: Path) -> None:
    times = [f"{n / 20}" for n in range(COUNT)]
    for k in range(2):
        video(tmp_path / f"trial_{k}.avi")
        forces(tmp_path / f"trial_{k}.csv", "t,fx,fy,fz", times)
    video(tmp_path / film, 200)
    found, doubts = read(tmp_path)
    assert sorted(found) == ["trial_0.avi", "trial_1.avi"]
    for one in found.values():
        check(one)
    assert any(film in line and "left out" in line for line in doubts)


def test_a_film_with_the_name_of_a_phone_and_forces_is_touch(tmp_path: Path) -> None:
    times = [f"{n / 20}" for n in range(COUNT)]
    for name in ("trial_0", "IMG_4321"):
        video(tmp_path / f"{name}.avi")
        forces(tmp_path / f"{name}.csv", "t,fx,fy,fz", times)
    found, _ = read(tmp_path)
    assert sorted(found) == ["IMG_4321.avi", "trial_0.avi"]


def test_films_that_all_have_the_names_of_a_phone_are_touch(tmp_path: Path) -> None:
    for name in ("IMG_4321", "IMG_4322"):
        video(tmp_path / f"{name}.avi")
    cv2.imwrite(str(tmp_path / "setup.png"), np.full((48, 64, 3), 90, np.uint8))
    found, _ = read(tmp_path)
    assert sorted(found) == ["IMG_4321.avi", "IMG_4322.avi"]


def test_names_behind_a_per_cent_sign_are_those_of_columns(tmp_path: Path) -> None:
    for k in range(2):
        video(tmp_path / f"trial_{k}.avi")
        rows = [f"{n / 20} 5.1 0 0 {z:.4f}" for n, z in enumerate(FORCE)]
        text = "\n".join(["% ATI Nano17", "% t G0 Fx Fy Fz", *rows])
        (tmp_path / f"trial_{k}.dat").write_text(text)
    found, _ = read(tmp_path)
    for one in found.values():
        check(one)


def test_a_table_of_the_normal_axis_has_its_force(tmp_path: Path) -> None:
    for k in range(2):
        video(tmp_path / f"trial_{k}/gel.avi")
        for axis in "xyz":
            rows = [f"{n / 20},{z if axis == 'z' else 9}" for n, z in enumerate(FORCE)]
            text = "time,value\n" + "\n".join(rows)
            (tmp_path / f"trial_{k}/F{axis}.csv").write_text(text)
        (tmp_path / f"trial_{k}/pos_z.csv").write_text("time,value\n0,7\n1,8\n")
    found, doubts = read(tmp_path)
    for one in found.values():
        check(one)
        assert one.force is not None
        assert np.isnan(one.force[:, :2]).all()
    assert any("Fx.csv" in line for line in doubts), doubts
