"""LeRobot v2.0 and v2.1 beside v3: one episode a file, tasks and episodes as lines of JSON."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from lerobot_recordings import all_of
from lerobot_sets import FPS, LEFT, PRESSURE, ROWS, WRENCH, changed, columns, made_set, pictures
from pyarrow import parquet
from tactileforge_lerobot import parquet as parquet_files
from tactileforge_lerobot.dataset import LeRobot

from tactileforge.plugin import ConfigError, DataError

TOUCH = {"touch": [LEFT], "sensors": ["gelsight_mini"]}


@pytest.mark.parametrize("version", ["v2.0", "v2.1", "v3.0"])
@pytest.mark.parametrize("images", ["video", "image"])
def test_every_field_comes_back(tmp_path: Path, version: str, images: str) -> None:
    root = made_set(tmp_path / "set", version, images)
    options: dict[str, Any] = {"force": [WRENCH], "tracks": [PRESSURE, WRENCH], **TOUCH}
    found = all_of(root, **options)
    assert len(found) == 2
    for number, recording in enumerate(found):
        wanted = columns(number)
        assert recording.key == f"set/{number:06d}/tactile_left"
        assert (recording.sensor, recording.text, recording.tier) == (
            "gelsight_mini",
            "press the ball",
            1,
        )
        assert recording.labels == {"episode": f"set_{number:05d}", "finger": "tactile_left"}
        np.testing.assert_allclose(recording.times, np.arange(ROWS) / FPS, atol=1e-6)
        np.testing.assert_array_equal(recording.force, wanted[WRENCH][:, :3])
        np.testing.assert_array_equal(recording.tracks["state"], wanted["observation.state"])
        np.testing.assert_array_equal(recording.tracks["robot_action"], wanted["action"])
        np.testing.assert_array_equal(recording.tracks["pressure_matrix"], wanted[PRESSURE])
        np.testing.assert_array_equal(recording.tracks["force_torque"], wanted[WRENCH])
        shown, near = recording.frames.read(range(ROWS)), 0 if images == "image" else 6
        assert shown.shape == (ROWS, 24, 32, 3)
        assert np.abs(shown.astype(int) - pictures(number)).max() <= near
        still = recording.no_contact.read([0])[0]
        np.testing.assert_array_equal(still, shown[0])
        assert recording.image is None
        assert recording.object is None
    assert LeRobot(str(root), **options).provides == {"force", "text"}


def test_the_camera_is_a_feature_like_any_other(tmp_path: Path) -> None:
    front = "observation.images.front"
    videos = {LEFT: [pictures(0)], front: [pictures(3, height=32, width=48)]}
    root = made_set(tmp_path / "set", episodes=1, videos=videos)
    (recording,) = all_of(root, camera=front, **TOUCH)
    assert recording.image.shape == (32, 48)
    assert recording.image.read([4])[0, 0, 0, 0] == pytest.approx(135, abs=3)
    np.testing.assert_array_equal(recording.image_times, recording.times)
    assert LeRobot(str(root), camera=front, **TOUCH).provides == {"text", "image"}


@pytest.mark.parametrize("images", ["video", "image"])
@pytest.mark.parametrize("shape", [[24, 32, 3], [32, 24, 3], [3, 24, 32]])
def test_the_picture_is_trusted_and_not_the_shape(
    tmp_path: Path, images: str, shape: list[int]
) -> None:
    root = made_set(tmp_path / "set", images=images, shapes={LEFT: shape})
    for recording in all_of(root, **TOUCH):
        assert recording.frames.shape == (24, 32)
        assert recording.frames.read([0, 4]).shape == (2, 24, 32, 3)


def test_paths_are_those_of_the_templates(tmp_path: Path) -> None:
    root = made_set(tmp_path / "set")
    (root / "data").rename(root / "tables")
    (root / "videos/chunk-000" / LEFT).rename(root / "films")
    (root / "films/episode_000001.mp4").rename(root / "films/1.mp4")
    (root / "films/episode_000000.mp4").rename(root / "films/0.mp4")
    path = "tables/chunk-{episode_chunk:03d}/episode_{episode_index:06d}.parquet"
    new = {"data_path": path, "video_path": "films/{episode_index}.mp4"}
    changed(root, "meta/info.json", lambda info: info.update(new))
    first, second = all_of(root, **TOUCH)
    assert second.frames.read([0])[0, 0, 0, 0] == pytest.approx(45, abs=3)
    assert first.frames.read([0])[0, 0, 0, 0] == pytest.approx(40, abs=3)


def test_chunks_hold_as_many_episodes_as_the_info_file_says(tmp_path: Path) -> None:
    root = made_set(tmp_path / "set", images="image", episodes=3)
    changed(root, "meta/info.json", lambda info: info.update(chunks_size=2))
    (root / "data/chunk-001").mkdir()
    name = "episode_000002.parquet"
    (root / "data/chunk-000" / name).rename(root / "data/chunk-001" / name)
    assert len(all_of(root, **TOUCH)) == 3
    changed(root, "meta/info.json", lambda info: info.update(chunks_size=0))
    with pytest.raises(DataError, match="chunks_size is 0, no number of episodes"):
        all_of(root, **TOUCH)


@pytest.mark.parametrize(
    ("pattern", "message"),
    [
        ("data/chunk-{chunk_index:03d}.parquet", "it may name episode_chunk, episode_index"),
        ("data/{episode_index:99999999999d}", "it may have episode_chunk, episode_index in braces"),
        ("data/{episode_index.__class__}", "it may have episode_chunk, episode_index in braces"),
        ("../{episode_index}.parquet", "lies outside the data set"),
    ],
)
def test_templates_are_plain_names(tmp_path: Path, pattern: str, message: str) -> None:
    root = made_set(tmp_path / "set", images="image")
    changed(root, "meta/info.json", lambda info: info.update(data_path=pattern))
    with pytest.raises(DataError, match=rf"info\.json, data_path: .*{message}"):
        list(LeRobot(str(root), val=0, **TOUCH).recordings("train"))


@pytest.mark.parametrize(
    ("lines", "message"),
    [
        ("", "episodes.jsonl: no episodes there"),
        ("[1]\n", "line 1: \\[1\\] is not a JSON object"),
        ('{"episode_index": 0\n', "line 1: not JSON"),
        ('{"episode_index": 0, "length": "5"}\n', "length is 5, no whole number"),
        ('{"episode_index": -1, "length": 5}\n', "episode_index is -1, no whole number"),
        ('{"length": 5}\n', "episode_index is None, no whole number"),
        ('{"episode_index": 1, "length": 5}\n' * 2, "episode 1 is there twice"),
        ("[" * 200000, "line 1: not JSON \\(nested too deep"),
    ],
)
def test_damaged_lists_of_episodes_are_named(tmp_path: Path, lines: str, message: str) -> None:
    root = made_set(tmp_path / "set", images="image")
    (root / "meta/episodes.jsonl").write_text(lines)
    with pytest.raises(DataError, match=message):
        list(LeRobot(str(root), val=0, **TOUCH).recordings("train"))


def test_the_task_of_a_row_is_looked_up_where_episodes_name_none(tmp_path: Path) -> None:
    root = made_set(tmp_path / "set", images="image")
    lines = [{"episode_index": n, "length": ROWS} for n in range(2)]
    (root / "meta/episodes.jsonl").write_text("\n\n".join(map(json.dumps, lines)))
    assert [one.text for one in all_of(root, **TOUCH)] == ["press the ball"] * 2
    (root / "meta/tasks.jsonl").write_text('{"task_index": 7, "task": "x"}\n{"task": 3}\n')
    assert [one.text for one in all_of(root, **TOUCH)] == [None, None]


@pytest.mark.parametrize("version", ["v2.1", "v3.0"])
def test_a_length_beyond_the_rows_allocates_nothing(tmp_path: Path, version: str) -> None:
    root = made_set(tmp_path / "set", version)
    if version == "v3.0":
        (path,) = (root / "meta/episodes").rglob("*.parquet")
        table = parquet.read_table(path)
        parquet.write_table(with_column("length", [10**12, ROWS])(table), path)
        parquet_files.forget()
    else:
        path = root / "meta/episodes.jsonl"
        first, *rest = path.read_text().splitlines()
        path.write_text("\n".join([json.dumps(json.loads(first) | {"length": 10**12}), *rest]))
    data = LeRobot(str(root), val=0, **TOUCH)
    assert [one.key for one in data.recordings("train")] == ["set/000001/tactile_left"]
    assert "5 rows of episode 0, but its length is 1000000000000" in data.skipped[0]


def damage(root: Path, change: Any) -> None:
    """Changes the table of the first episode."""
    path = root / "data/chunk-000/episode_000000.parquet"
    parquet.write_table(change(parquet.read_table(path)), path)
    parquet_files.forget()


def with_column(name: str, cells: list[Any]) -> Any:
    import pyarrow as pa

    return lambda table: table.set_column(table.column_names.index(name), name, pa.array(cells))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            lambda t: t.rename_columns([f"{n}s" if n == WRENCH else n for n in t.column_names]),
            f"unknown column '{WRENCH}'; did you mean '{WRENCH}s'",
        ),
        (lambda t: t.slice(0, 3), "3 rows of episode 0, but its length is 5"),
        (with_column("timestamp", [0.0, 0.1, 0.2, 0.2, 0.4]), "does not rise at row 3"),
        (with_column("timestamp", [0.0, 0.1, 0.0, 0.1, 0.2]), "does not rise at row 2"),
        (
            with_column("timestamp", [0.0, 0.1, float("nan"), 0.3, 0.4]),
            "without a step in time|does not rise at row 2|comes",
        ),
        (with_column(WRENCH, [[1.0] * 6] * 4 + [[1.0] * 5]), "lists of 5 to 6 numbers"),
        (with_column(WRENCH, [[1.0] * 6] * 4 + [None]), "and cells without one"),
        (with_column(WRENCH, [[1.0] * 4] * 5), r"4 numbers a row, where .* says \[6\]"),
        (with_column(WRENCH, [["a"] * 6] * 5), "holds string, no numbers"),
    ],
)
def test_a_damaged_episode_is_skipped_and_counted(
    tmp_path: Path, change: Any, message: str
) -> None:
    root = made_set(tmp_path / "set", images="image")
    damage(root, change)
    data = LeRobot(str(root), force=[WRENCH], val=0, **TOUCH)
    (recording,) = data.recordings("train")
    assert recording.key == "set/000001/tactile_left"
    (line,) = data.skipped
    import re

    assert re.search(message, line), line
    assert "\n" not in line


def test_an_empty_episode_or_one_that_is_not_there_is_skipped(tmp_path: Path) -> None:
    root = made_set(tmp_path / "set", episodes=4)
    lines = [{"episode_index": n, "length": ROWS * (n != 1)} for n in range(4)]
    (root / "meta/episodes.jsonl").write_text("\n".join(map(json.dumps, lines)))
    (root / "data/chunk-000/episode_000002.parquet").unlink()
    film = root / "videos/chunk-000" / LEFT / "episode_000003.mp4"
    film.write_bytes(film.read_bytes()[:200])
    data = LeRobot(str(root), val=0, **TOUCH)
    assert [one.key for one in data.recordings("train")] == ["set/000000/tactile_left"]
    empty, gone, cut = data.skipped
    assert "episode 1 is empty" in empty
    assert "episode_000002.parquet: not there" in gone
    assert "episode_000003.mp4" in cut


def test_a_video_that_is_too_short_is_named(tmp_path: Path) -> None:
    root = made_set(tmp_path / "set", videos={LEFT: [pictures(0), pictures(1, rows=4)]})
    data = LeRobot(str(root), val=0, **TOUCH)
    assert len(list(data.recordings("train"))) == 1
    assert "4 frames, but episode 1 needs 5" in data.skipped[0]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"force_columns": []}, r"data\.force_columns=\[\]: give x, y and z"),
        ({"force_columns": [], "touch": None, "sensors": ()}, "give x, y and z"),
        ({"force_columns": [0, 1, -2]}, "give x, y and z"),
        ({"force_sign": [1, 1]}, "give three factors"),
        ({"force_sign": [1, 0, 1]}, "none 0"),
        ({"force_tare": -1}, "give a number of rows"),
        ({"force_tare_most": 0.5}, "and data.force_tare"),
        ({"sensors": ["digit", "digit"]}, "names 1 features and data.sensors 2"),
    ],
)
def test_bad_options_are_named(options: dict[str, Any], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        LeRobot("set", **{**TOUCH, **options})


def test_a_star_stands_for_several_features_of_one_sensor(tmp_path: Path) -> None:
    videos = {f"observation.images.tactile_{side}": [pictures(0)] for side in ("left", "right")}
    root = made_set(tmp_path / "set", episodes=1, videos=videos)
    found = all_of(root, touch=["observation.images.*"], sensors=["digit"])
    assert [one.key for one in found] == ["set/000000/tactile_left", "set/000000/tactile_right"]
    with pytest.raises(ConfigError, match="names 1 features, for 2 of touch"):
        all_of(root, touch=["observation.images.*"], sensors=["digit"], force=[WRENCH])
    with pytest.raises(DataError, match=r"unknown feature in data.touch 'observation.film.\*'"):
        all_of(root, touch=["observation.film.*"], sensors=["digit"])


def test_forces_are_turned_into_newton_along_the_axes(tmp_path: Path) -> None:
    root = made_set(tmp_path / "set", images="image")
    options = {"force": [WRENCH], "force_columns": [1, 0, 2], **TOUCH}
    (first, _) = all_of(root, **options, force_sign=[-1, 0.001, 9.80665])
    wanted = columns(0)[WRENCH][:, [1, 0, 2]] * [-1, 0.001, 9.80665]
    np.testing.assert_allclose(first.force, wanted, rtol=1e-6)
    found = all_of(root, **options, force_sign=[1, 1, "mean"])
    z = np.concatenate([columns(n)[WRENCH][:, 2] for n in range(2)])
    turned = np.concatenate([one.force[:, 2] for one in found])
    np.testing.assert_allclose(turned, z * np.sign(z.mean()), rtol=1e-6)
    assert turned.mean() > 0


def test_several_sets_below_a_folder_are_read_one_after_the_other(tmp_path: Path) -> None:
    for name in ("b", "a/deep"):
        made_set(tmp_path / "all" / name, images="image", episodes=1)
    lacks = made_set(tmp_path / "all/c", images="image", episodes=1, videos={})
    data = LeRobot(str(tmp_path / "all"), val=0, **TOUCH)
    keys = [one.key for one in data.recordings("train")]
    assert keys == ["all/a/deep/000000/tactile_left", "all/b/000000/tactile_left"]
    (line,) = data.skipped
    assert line.startswith(f"{lacks}: unknown feature in data.touch '{LEFT}'")
    assert list(data.recordings("val")) == []


def test_pictures_are_put_upright_with_their_background(tmp_path: Path) -> None:
    root = made_set(tmp_path / "set", images="image", episodes=1)
    (plain,) = all_of(root, **TOUCH)
    (one,) = all_of(root, **TOUCH, channels="bgr", rotate=90, mirror="x")
    want = np.rot90(plain.frames.read([0, 1])[:, :, ::-1, ::-1], -1, axes=(1, 2))
    np.testing.assert_array_equal(one.frames.read([0, 1]), want)
    np.testing.assert_array_equal(one.no_contact.read([0]), want[:1])
    with pytest.raises(ConfigError, match="data: rotate is 45; give the degrees, clockwise"):
        all_of(root, **TOUCH, rotate=45)
