"""Training data of a policy: state, actions, task, of one episode with several fingers."""

import json
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from lerobot_recordings import PSNR, all_of, demonstration, psnr, touch
from tactileforge_lerobot import folder
from tactileforge_lerobot import parquet as parquet_files
from tactileforge_lerobot.options import LeRobotOptions
from tactileforge_lerobot.parquet import read_parquet
from tactileforge_lerobot.write import write_dataset

from tactileforge import cli
from tactileforge.plugin import DataError


def test_fingers_of_an_episode_are_one_with_state_and_action_once(tmp_path: Path) -> None:
    wanted = [part for number in range(3) for part in demonstration(number)]
    summary = write_dataset(wanted, tmp_path / "set", LeRobotOptions())
    assert (summary.episodes, summary.rows, summary.fps, summary.lacks) == (3, 72, 6, [])
    info = json.loads((tmp_path / "set/meta/info.json").read_text())
    robot = [name for name in info["features"] if "state" in name or "action" in name]
    assert robot == ["observation.state", "action"]
    assert info["features"]["action"]["shape"] == [4]
    assert info["features"]["observation.state"]["dtype"] == "float32"
    table = read_parquet(tmp_path / "set/data/chunk-000/file-000.parquet").to_pydict()
    np.testing.assert_array_equal(table["action"][24:48], wanted[2].tracks["robot_action"])
    np.testing.assert_array_equal(table["observation.state"][:24], wanted[0].tracks["state"])
    stats = json.loads((tmp_path / "set/meta/stats.json").read_text())
    every = np.concatenate([part.tracks["state"] for part in wanted[::2]])
    np.testing.assert_allclose(stats["observation.state"]["max"], every.max(0), rtol=1e-6)
    for new, old in zip(all_of(tmp_path / "set"), wanted, strict=True):
        assert (new.key, new.text, new.labels) == (old.key, old.text, old.labels)
        assert sorted(new.tracks) == ["robot_action", "state"]
        for name, values in old.tracks.items():
            assert new.tracks[name].dtype == np.float32
            np.testing.assert_array_equal(new.tracks[name], values)
        assert psnr(new.frames.read([3, 20]), old.frames.read([3, 20])) > PSNR
        assert (new.image is None) == (old.image is None)
        if old.image is not None:
            assert psnr(new.image.read([5]), old.image.read([5])) > PSNR


def test_no_action_is_lost_where_a_slow_sensor_shows_a_frame_again(tmp_path: Path) -> None:
    left, right = demonstration(0)
    rows = list(range(0, 24, 2))
    write_dataset([left, right.select(rows)], tmp_path / "set", LeRobotOptions(images="png"))
    for recording in all_of(tmp_path / "set"):
        np.testing.assert_array_equal(
            recording.tracks["robot_action"], left.tracks["robot_action"][:23]
        )
        np.testing.assert_allclose(np.diff(recording.times), 1 / 6, atol=1e-9)
    frames = recording.frames.read(range(23))
    shown = [np.flatnonzero((right.frames.read(rows) == frame).all((1, 2, 3))) for frame in frames]
    assert [int(places[0]) for places in shown][::2] == list(range(12))


def test_state_and_actions_of_others_become_tracks(tmp_path: Path) -> None:
    """A data set without our metadata still has the task's words, the state and the actions."""
    root = tmp_path / "set"
    write_dataset(demonstration(0), root, LeRobotOptions(images="png"))
    (root / folder.TOUCH).unlink()
    sensors = {
        "touch": ["observation.images.left", "observation.images.right"],
        "sensors": ["digit", "digit"],
    }
    new = all_of(root, **sensors)
    for recording, finger in zip(new, ("left", "right"), strict=True):
        assert recording.text == "pick the chip up"
        assert recording.labels == {"episode": "set_00000", "finger": finger}
        for name, values in demonstration(0)[0].tracks.items():
            np.testing.assert_array_equal(recording.tracks[name], values)
    again = write_dataset(new, tmp_path / "again", LeRobotOptions(images="png"))
    assert (again.episodes, again.rows, again.lacks) == (1, 24, [])


def test_the_task_is_found_where_episodes_do_not_name_it(tmp_path: Path) -> None:
    root = tmp_path / "set"
    write_dataset(demonstration(0), root, LeRobotOptions(images="png"))
    (root / folder.TOUCH).unlink()
    parquet = parquet_files.import_arrow().parquet
    path = next((root / "meta/episodes").rglob("*.parquet"))
    table = parquet.read_table(path)
    parquet.write_table(table.drop_columns(["tasks"]), path)
    parquet_files.forget()
    (recording,) = all_of(root, touch=["observation.images.left"], sensors=["digit"])
    assert recording.text == "pick the chip up"


@pytest.mark.parametrize("kind", ["path", "outside", "gone", "neither"])
def test_images_in_tables_may_be_paths_inside_the_set(tmp_path: Path, kind: str) -> None:
    root = tmp_path / "set"
    wanted = touch(0)
    write_dataset([wanted], root, LeRobotOptions(images="png"))
    arrow = parquet_files.import_arrow()
    path = next((root / "data").rglob("*.parquet"))
    table = arrow.parquet.read_table(path)
    name = "observation.images.digit"
    cells = table[name].to_pylist()
    (root / "images").mkdir()
    (tmp_path / "secret.png").write_bytes(cells[0]["bytes"])
    for i, cell in enumerate(cells):
        (root / f"images/{i}.png").write_bytes(cell["bytes"])
    files = {"path": "images/{}.png", "outside": "../secret.png", "gone": "x.png", "neither": None}
    place = files[kind]
    moved = [{"bytes": None, "path": place and place.format(i)} for i in range(len(cells))]
    column = arrow.array(moved, table[name].type)
    table = table.set_column(table.column_names.index(name), name, column)
    arrow.parquet.write_table(table, path)
    parquet_files.forget()
    (recording,) = all_of(root)
    if kind == "path":
        rows = range(len(cells))
        np.testing.assert_array_equal(recording.frames.read(rows), wanted.frames.read(rows))
        return
    message = {"outside": "lies outside", "gone": "cannot be read", "neither": "neither bytes"}
    with pytest.raises(DataError, match=message[kind]):
        recording.frames.read([2])


def test_rows_whose_state_is_not_known_are_cut_at_the_ends_and_named_in_between(
    tmp_path: Path,
) -> None:
    left, right = demonstration(0)
    tracks = {name: values.copy() for name, values in left.tracks.items()}
    tracks["state"][:2], tracks["robot_action"][-3:] = np.nan, np.nan
    parts = [replace(part, tracks=tracks) for part in (left, right)]
    assert write_dataset(parts, tmp_path / "cut", LeRobotOptions()).rows == 24 - 5
    np.testing.assert_array_equal(
        all_of(tmp_path / "cut")[1].tracks["state"], tracks["state"][2:-3]
    )
    tracks["state"][10] = np.nan
    with pytest.raises(DataError, match=r"chip_00000/left: state is not a number in 3 of 24 rows"):
        write_dataset(parts, tmp_path / "hole", LeRobotOptions())


def test_parts_of_an_episode_that_are_apart_are_named(tmp_path: Path) -> None:
    (left, right), (other, _) = demonstration(0), demonstration(1)
    with pytest.raises(DataError, match="episode chip_00000 do not follow one another"):
        write_dataset([left, other, right], tmp_path / "set", LeRobotOptions())


def test_the_verb_says_what_a_policy_lacks(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name, recordings in (("touch", [touch(0)]), ("demos", demonstration(0))):
        write_dataset(recordings, tmp_path / name, LeRobotOptions(images="png"))
        words = ["data=lerobot", f"data.root={tmp_path / name}", "data.val=0"]
        assert cli.run(["data", "lerobot", *words, f"out={tmp_path / name}2"]) == 0
        out = capsys.readouterr().out
        lacks = "no observation.state and no action: LeRobot trains no policy on it"
        assert (lacks in out) == (name == "touch")


def test_videos_of_lerobot_are_av1(tmp_path: Path) -> None:
    """End to end: a data set with AV1 videos, as written by LeRobot's recorder."""
    av = pytest.importorskip("av")
    if "libsvtav1" not in av.codecs_available:
        pytest.skip("this PyAV has no encoder of AV1")
    root = tmp_path / "set"
    wanted = demonstration(0)
    write_dataset(wanted, root, LeRobotOptions())
    for path in list(root.rglob("*.mp4")):
        capture = cv2.VideoCapture(str(path))
        frames = [capture.read()[1] for _ in range(24)]
        height, width = frames[0].shape[:2]
        with av.open(str(path), "w") as container:
            options = {"g": "2", "crf": "10", "preset": "10"}
            stream = container.add_stream("libsvtav1", rate=6, options=options)
            stream.width, stream.height, stream.pix_fmt = width, height, "yuv420p"
            for frame in frames:
                picture = av.VideoFrame.from_ndarray(frame, format="bgr24")
                container.mux(stream.encode(picture))
            container.mux(stream.encode(None))
    for new, old in zip(all_of(root), wanted, strict=True):
        np.testing.assert_array_equal(new.tracks["state"], old.tracks["state"])
        assert psnr(new.frames.read(range(24)), old.frames.read(range(24))) > 30
