"""Touch to a LeRobot data set and back; and data sets of other programs."""

import json
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pyarrow as pa
import pytest
from bent import bent
from lerobot_recordings import PSNR, all_of, psnr, touch
from numpy.typing import NDArray
from omegaconf import OmegaConf
from pyarrow import parquet
from tactileforge_lerobot import folder
from tactileforge_lerobot import parquet as parquet_files
from tactileforge_lerobot.dataset import LeRobot
from tactileforge_lerobot.info import Info
from tactileforge_lerobot.options import LeRobotOptions
from tactileforge_lerobot.statistics import image_statistics, number_statistics
from tactileforge_lerobot.write import write_dataset

from tactileforge import cli
from tactileforge.cli._compose import compose
from tactileforge.plugin import (
    ArrayFrames,
    ConfigError,
    DataError,
    DataNotFoundError,
    TactileForgeError,
)
from tactileforge.plugins import registry
from tactileforge.testing import check


def test_a_round_trip_keeps_everything(tmp_path: Path) -> None:
    """Frames to 36 dB, forces, actions and tracks exactly, times within 1 ms."""
    wanted = [touch(0), touch(1, frames=31)]
    summary = write_dataset(wanted, tmp_path / "set", LeRobotOptions())
    assert (summary.episodes, summary.rows, summary.fps) == (2, 55, 30)
    assert summary.dropped == {"digit": 0}
    recordings = all_of(tmp_path / "set")
    assert len(recordings) == 2
    for new, old in zip(recordings, wanted, strict=True):
        rows = range(len(old.frames))
        assert psnr(new.frames.read(rows), old.frames.read(rows)) > PSNR
        assert np.abs(new.times - old.times).max() < 1e-3
        np.testing.assert_array_equal(new.force, old.force)
        np.testing.assert_array_equal(new.action, old.action)
        np.testing.assert_array_equal(new.tracks["wrench"], old.tracks["wrench"])
        np.testing.assert_array_equal(new.no_contact.read([0]), old.no_contact.read([0]))
        for name in ("key", "sensor", "object", "text", "labels", "source", "tier", "licence"):
            assert getattr(new, name) == getattr(old, name), name


def test_the_folder_is_what_lerobot_reads(tmp_path: Path) -> None:
    root = tmp_path / "set"
    write_dataset([touch(0), touch(1, frames=31)], root, LeRobotOptions(robot="so101_follower"))
    info = json.loads((root / "meta/info.json").read_text())
    assert info["codebase_version"] == "v3.0"
    assert (info["total_episodes"], info["total_frames"], info["total_tasks"]) == (2, 55, 1)
    assert info["robot_type"] == "so101_follower"
    video = info["features"]["observation.images.digit"]
    assert (video["dtype"], video["shape"]) == ("video", [64, 48, 3])
    table = parquet.read_table(root / info["data_path"].format(chunk_index=0, file_index=0))
    assert set(table.column_names) == set(info["features"]) - {"observation.images.digit"}
    columns = table.to_pydict()
    assert columns["index"] == list(range(55))
    assert columns["frame_index"] == [*range(24), *range(31)]
    assert columns["episode_index"] == [0] * 24 + [1] * 31
    assert columns["timestamp"][23] == pytest.approx(23 / 30)
    assert columns["observation.force.digit"][0] == touch(0).force[0].tolist()
    episodes = parquet.read_table(root / "meta/episodes/chunk-000/file-000.parquet").to_pylist()
    assert [episode["length"] for episode in episodes] == [24, 31]
    assert [episode["dataset_to_index"] for episode in episodes] == [24, 55]
    key = "videos/observation.images.digit"
    assert [episode[f"{key}/from_timestamp"] for episode in episodes] == pytest.approx([0, 0.8])
    assert episodes[1][f"{key}/to_timestamp"] == pytest.approx(55 / 30)
    assert episodes[0]["tasks"] == ["touch the cup"]
    force = touch(0).force
    np.testing.assert_allclose(
        episodes[0]["stats/observation.force.digit/mean"], force.mean(0), rtol=1e-5
    )
    capture = cv2.VideoCapture(str(root / key / "chunk-000/file-000.mp4"))
    assert capture.get(cv2.CAP_PROP_FRAME_COUNT) == 55
    assert capture.get(cv2.CAP_PROP_FPS) == pytest.approx(30)
    tasks = parquet.read_table(root / "meta/tasks.parquet")
    assert tasks.to_pydict() == {"task_index": [0], "task": ["touch the cup"]}
    assert json.loads(tasks.schema.metadata[b"pandas"])["index_columns"] == ["task"]
    stats = json.loads((root / "meta/stats.json").read_text())
    assert set(stats) == set(info["features"])
    both = np.concatenate([touch(0).force, touch(1, frames=31).force])
    np.testing.assert_allclose(stats["observation.force.digit"]["std"], both.std(0), rtol=1e-5)
    assert np.shape(stats["observation.images.digit"]["mean"]) == (3, 1, 1)


def test_sensors_of_one_take_share_rows(tmp_path: Path) -> None:
    """Frames of the slower sensor are repeated in rows; read back, each occurs once."""
    fast = replace(touch(0), labels={"take": 0, "device": "left"})
    slow = replace(
        touch(0, "gelsight_mini", 15, 18.75), labels={"take": 0, "device": "right"}, tracks={}
    )
    summary = write_dataset([fast, slow], tmp_path / "set", LeRobotOptions())
    assert summary.episodes == 1
    assert summary.dropped["right"] == 0
    left, right = all_of(tmp_path / "set")
    assert (left.sensor, right.sensor) == ("digit", "gelsight_mini")
    shared = min(fast.times[-1], slow.times[-1])
    assert left.times[-1] == pytest.approx(shared, abs=1 / 60 + 1e-6)
    np.testing.assert_array_equal(right.times, slow.times)
    np.testing.assert_array_equal(right.force, slow.force)
    assert psnr(right.frames.read([3, 14]), slow.frames.read([3, 14])) > PSNR


def test_arrays_and_odd_sizes_and_the_camera(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    noise = rng.integers(0, 256, (12, 4, 5, 3)).astype(np.uint8)
    array = replace(
        touch(0, frames=12), sensor="serial_array", frames=ArrayFrames(noise), no_contact=None
    )
    write_dataset([array], tmp_path / "array", LeRobotOptions())
    (recording,) = all_of(tmp_path / "array")
    np.testing.assert_array_equal(recording.frames.read(range(12)), noise)  # without loss
    assert recording.no_contact is None
    odd = touch(1)
    odd = replace(odd, frames=ArrayFrames(odd.frames.read(range(24))[:, :63, :47]))
    view = ArrayFrames(
        np.full((3, 32, 32, 3), 1, np.uint8)
        * np.array([0, 120, 240], np.uint8)[:, None, None, None]
    )
    odd = replace(odd, image=view)
    write_dataset([odd], tmp_path / "odd", LeRobotOptions())
    (recording,) = all_of(tmp_path / "odd")
    assert recording.frames.shape == (63, 47)
    assert psnr(recording.frames.read([5]), odd.frames.read([5])) > PSNR
    assert recording.image.read([0, 12, 23]).mean((1, 2, 3)) == pytest.approx([0, 120, 240], abs=4)


def test_files_are_split_by_size(tmp_path: Path) -> None:
    many = [touch(number) for number in range(3)]
    write_dataset(many, tmp_path / "set", LeRobotOptions(data_mb=1e-3, video_mb=1e-5))
    assert len(list((tmp_path / "set/data").rglob("*.parquet"))) == 3
    assert len(list((tmp_path / "set/videos").rglob("*.mp4"))) == 3
    for new, old in zip(all_of(tmp_path / "set"), many, strict=True):
        np.testing.assert_array_equal(new.force, old.force)
        assert psnr(new.frames.read([20]), old.frames.read([20])) > PSNR


def test_data_sets_of_others_are_read(tmp_path: Path) -> None:
    """Without our file in meta/, the touch features are given by name."""
    root = tmp_path / "set"
    write_dataset([touch(0), touch(1)], root, LeRobotOptions())
    (root / folder.TOUCH).unlink()
    options = {"touch": ["observation.images.digit"], "sensors": ["gelsight_mini"]}
    recording, _ = all_of(
        root, **options, force=["observation.wrench.digit"], force_columns=[3, 4, 5]
    )
    assert (recording.sensor, recording.key, recording.text) == (
        "gelsight_mini",
        "set/000000/digit",
        "touch the cup",
    )
    np.testing.assert_array_equal(recording.force, touch(0).tracks["wrench"][:, 3:])
    np.testing.assert_array_equal(recording.no_contact.read([0]), recording.frames.read([0]))
    assert all_of(root, **options, background="none")[0].no_contact is None
    with pytest.raises(ConfigError, match=r"which features are touch\? .*observation.images.digit"):
        all_of(root)
    with pytest.raises(DataError, match=r"did you mean 'observation.images.digit'"):
        all_of(root, touch=["observation.images.digt"], sensors=["digit"])
    with pytest.raises(DataError, match="3 columns, but force_columns"):
        all_of(root, **options, force=["observation.force.digit"], force_columns=[3, 4, 5])


@pytest.mark.parametrize("named", [["x_kg", "y_kg", "z_kg"], {"axes": ["Fx [kg]", "Fy", "Fz"]}])
def test_forces_in_another_unit_by_their_names(tmp_path: Path, named: object) -> None:
    root = tmp_path / "set"
    write_dataset([touch(0)], root, LeRobotOptions())
    about = json.loads((root / folder.INFO).read_text())
    about["features"]["observation.force.digit"]["names"] = named
    (root / folder.INFO).write_text(json.dumps(about))
    with pytest.raises(ConfigError, match=r"is in kgf by its name.*data.force_unit: kgf"):
        all_of(root)
    (same,) = all_of(root, force_sign=[9.80665, 9.80665, 9.80665])
    (one,) = all_of(root, force_unit="kgf")
    np.testing.assert_array_equal(same.force, one.force)
    np.testing.assert_allclose(one.force, touch(0).force * 9.80665, rtol=1e-6)


def test_forces_of_several_sensors_are_columns_of_one_feature(tmp_path: Path) -> None:
    root = tmp_path / "set"
    write_dataset([touch(0)], root, LeRobotOptions())
    (root / folder.TOUCH).unlink()
    first, second = all_of(
        root,
        touch=["observation.images.digit"] * 2,
        sensors=["digit", "gelsight_mini"],
        force=["observation.wrench.digit"] * 2,
        force_columns=[0, 1, 2, 5, 4, 3],
    )
    wrench = touch(0).tracks["wrench"]
    np.testing.assert_array_equal(first.force, wrench[:, :3])
    np.testing.assert_array_equal(second.force, wrench[:, [5, 4, 3]])


@pytest.mark.slow
def test_trex_has_ten_fingertips_without_forces(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Names of the features as its schema states them, on a folder of the same shape."""
    fingers = ("thumb", "index", "middle", "ring", "pinky")
    names = [f"tactile_{side}_raw_{finger}" for side in ("left", "right") for finger in fingers]
    takes = [replace(touch(0), key=n, labels={"take": 0, "device": n}) for n in names]
    write_dataset(takes, tmp_path / "set", LeRobotOptions())
    (tmp_path / "set" / folder.TOUCH).unlink()
    words = ["data=trex", f"data.root={tmp_path / 'set'}", "data.val=0", "trex.sensor=digit"]
    config = compose("anytouch2", [*words, "data.camera=null"])
    node = OmegaConf.to_container(config.data, resolve=True)
    data = registry.build("datasets", {k: v for k, v in node.items() if k != "max_bad"})
    found = list(data.recordings("train"))
    assert [recording.key.rsplit("/", 1)[1] for recording in found] == names
    assert {recording.sensor for recording in found} == {"digit"}
    assert [recording.force for recording in found] == [None] * 10
    assert data.provides == {"action", "text"}
    assert compose("anytouch2", words).data.camera == "observation.images.head_left"
    assert cli.run(["train", *words[:-1]]) == 1
    assert "error: give trex.sensor=..." in capsys.readouterr().err


def test_the_verbs_go_both_ways(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_dataset([touch(n) for n in range(4)], tmp_path / "a", LeRobotOptions(images="png"))
    words = ["data=lerobot", f"data.root={tmp_path / 'a'}", "data.val=0"]
    packed = [f"out={tmp_path / 'shards'}", "pack.processes=1", "pack.codec=png"]
    assert cli.run(["data", "pack", *words, *packed]) == 0
    back = ["data=shards", f"data.root={tmp_path / 'shards'}", f"out={tmp_path / 'b'}"]
    assert cli.run(["data", "lerobot", *back, "lerobot.images=png"]) == 0
    assert "4 episodes, 96 rows at 30 per second" in capsys.readouterr().out
    by_key = {recording.key: recording for recording in all_of(tmp_path / "b")}
    for number in range(4):
        new, old = by_key[touch(number).key], touch(number)
        np.testing.assert_array_equal(new.frames.read(range(24)), old.frames.read(range(24)))
        np.testing.assert_array_equal(new.force, old.force)
        np.testing.assert_allclose(new.times, old.times, atol=1e-9)
    assert cli.run(["data", "lerobot", *back]) == 1
    assert "exists: give another out=" in capsys.readouterr().err


def test_what_cannot_be_written_is_named(tmp_path: Path) -> None:
    other = touch(1, "gelsight_mini")
    still = replace(touch(0, frames=1))
    apart = replace(touch(1, "gelsight"), times=touch(1).times + 9)
    labels = {"take": 1}
    for recordings, options, message in (
        ([], LeRobotOptions(), "there are no recordings"),
        ([touch(0), other], LeRobotOptions(), r"touch/1/gelsight_mini: other features .*devices"),
        ([still], LeRobotOptions(), "has no rate: give fps"),
        (
            [replace(touch(0), labels=labels), replace(apart, labels=labels)],
            LeRobotOptions(),
            "do not overlap in time",
        ),
    ):
        with pytest.raises(DataError, match=message):
            write_dataset(recordings, tmp_path / "set", options)
        assert list(tmp_path.iterdir()) == []
    assert (
        write_dataset(
            [touch(0), other], tmp_path / "set", LeRobotOptions(devices=["digit"])
        ).episodes
        == 1
    )
    for wrong in ({"fps": 0}, {"images": "gif"}):
        with pytest.raises(ConfigError, match=next(iter(wrong))):
            LeRobotOptions(**wrong)


def test_damage_is_named(tmp_path: Path) -> None:
    root = tmp_path / "set"
    with pytest.raises(DataNotFoundError, match=r"set data\.root"):
        all_of(root)
    write_dataset([touch(0), touch(1)], root, LeRobotOptions())
    info = (root / folder.INFO).read_text()
    for old, new, message in (
        ('"v3.0"', '"v1.6"', r"format v1\.6, but only v2\.0, v2\.1 and v3 can be read"),
        ('"v3.0"', '"v2.1"', r"episodes\.jsonl: not there"),
        ('"fps": 30', '"fps": "x"', "not a LeRobot info file"),
        ('"fps": 30,', '"fps": 0,', "fps=0"),
        ("{", "", "not a LeRobot info file"),
    ):
        (root / folder.INFO).write_text(info.replace(old, new, 1))
        with pytest.raises(DataError, match=message):
            all_of(root)
    (root / folder.INFO).write_text(info)
    held = (root / folder.TOUCH).read_text()
    (root / folder.TOUCH).write_text(held.replace('"version": 1', '"version": 9'))
    with pytest.raises(DataError, match="version 9"):
        all_of(root)
    (root / folder.TOUCH).write_text(held)
    video = next(root.rglob("*.mp4"))
    video.write_bytes(video.read_bytes()[:900])
    parquet_files.forget()
    with pytest.raises(DataError, match=r"file-000\.mp4"):
        all_of(root)
    next((root / "data").rglob("*.parquet")).write_bytes(b"PAR1 no")
    with pytest.raises(DataError, match=r"file-000"):
        all_of(root)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"val": 1.0}, "val is 1.0"),
        ({"background": "last"}, "unknown data.background 'last'"),
        ({"touch": ["a"], "sensors": []}, "names 1 features and data.sensors 0"),
        ({"touch": ["a"], "sensors": ["digit"], "force": []}, "names 0 features, for 1"),
        ({"force_columns": [0, 1]}, "give x, y and z"),
        ({"force_columns": [0] * 9, "touch": ["a", "b"], "sensors": ["c", "d"]}, "for each"),
    ],
)
def test_bad_options_are_named(options: dict[str, object], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        LeRobot(".", **options)


def test_statistics_by_hand() -> None:
    statistics = number_statistics(np.array([[0.0, 1.0], [2.0, 5.0], [np.nan, 3.0]]))
    assert statistics["min"] == [0, 1]
    assert statistics["mean"] == [1, 3]
    assert statistics["std"] == [1, 2]
    assert statistics["q50"] == [1, 3]
    assert statistics["count"] == [2]
    white = image_statistics(np.full((2, 4, 4, 3), 255, np.uint8))
    assert white["mean"] == [[[1.0]], [[1.0]], [[1.0]]]
    assert white["count"] == [2]


def test_it_conforms(tmp_path: Path) -> None:
    write_dataset([touch(n) for n in range(8)], tmp_path / "set", LeRobotOptions())
    assert LeRobot(str(tmp_path / "set")).provides == {"force", "action", "object", "text"}
    assert LeRobot(str(tmp_path / "none")).provides == frozenset()
    results = check("dataset", LeRobot, root=str(tmp_path / "set"), val=0.4)
    assert [r for r in results if r.status == "failed"] == []
    assert sum(r.status == "ran" for r in results) > 5


def test_a_label_that_is_no_number_goes_both_ways(tmp_path: Path) -> None:
    write_dataset(
        [replace(touch(0), labels={"mass": np.nan, "size": 2.0})],
        tmp_path / "set",
        LeRobotOptions(),
    )
    (recording,) = all_of(tmp_path / "set")
    assert np.isnan(recording.labels["mass"])
    assert recording.labels["size"] == 2


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda about: about.pop("sensor"), "sensor is None, not of type str"),
        (lambda about: about.update(background=[3]), r"background is \[3\], not a list of paths"),
        (lambda about: about.update(background=["../a.png"]), r"a\.png lies outside the data set"),
        (lambda about: about.update(shape=[3]), r"shape is \[3\], not height and width"),
        (lambda about: about.update(labels=[1]), r"labels is \[1\], not of type dict"),
    ],
)
def test_damaged_metadata_of_touch_is_named(
    change: Callable[[dict[str, Any]], object], message: str, tmp_path: Path
) -> None:
    cv2.imwrite(str(tmp_path / "a.png"), np.zeros((64, 48, 3), np.uint8))
    root = tmp_path / "set"
    write_dataset([touch(0)], root, LeRobotOptions())
    held = json.loads((root / folder.TOUCH).read_text())
    for about in held["episodes"][0].values():
        change(about)
    (root / folder.TOUCH).write_text(json.dumps(held))
    with pytest.raises(DataError, match=message):
        all_of(root)


@pytest.mark.parametrize(
    ("pattern", "message"),
    [
        ("data/{chunk}/x.parquet", r"cannot be filled in \(KeyError"),
        ("../{chunk_index}/{file_index}.parquet", "lies outside the data set, and is not opened"),
        ("{episode_chunk:99999999999d}/x.parquet", "cannot be filled in; it may have chunk_index"),
        ("{chunk_index:99999999999d}/x.parquet", "cannot be filled in; it may have chunk_index"),
        ("{chunk_index.__class__}/x.parquet", "cannot be filled in; it may have chunk_index"),
        ("{chunk_index!r}/x.parquet", "cannot be filled in"),
        ("{chunk_index[0]}/x.parquet", "cannot be filled in"),
        ("{0}/x.parquet", "cannot be filled in"),
        ("{chunk_index:{file_index}d}/x.parquet", "cannot be filled in"),
        ("data/{chunk_index", "cannot be filled in"),
        ("{chunk_index}" * 2000, "cannot be filled in"),
        ("data/\0.parquet", "is not a path"),
        ("a" * 300, "is not a path"),
    ],
)
def test_a_path_of_the_info_file_stays_inside(pattern: str, message: str, tmp_path: Path) -> None:
    root = tmp_path / "set"
    write_dataset([touch(0)], root, LeRobotOptions())
    info = json.loads((root / folder.INFO).read_text())
    (root / folder.INFO).write_text(json.dumps(info | {"data_path": pattern}))
    with pytest.raises(DataError, match=rf"info\.json, data_path: .*{message}"):
        all_of(root)


def test_episodes_that_are_cut_off_are_named(tmp_path: Path) -> None:
    write_dataset([touch(0)], tmp_path / "set", LeRobotOptions())
    path = next((tmp_path / "set" / "meta" / "episodes").rglob("*.parquet"))
    path.write_bytes(path.read_bytes()[:200])
    with pytest.raises(DataError, match=r"file-000\.parquet: cannot be read"):
        all_of(tmp_path / "set")


def test_a_long_episode_is_read_in_parts(tmp_path: Path) -> None:
    """The camera's images are the nearest in time; never are all frames in memory at once."""
    frames = [CountedFrames(np.full((300, 32, 32, 3), 9, np.uint8)) for _ in range(2)]
    times = np.arange(300) / 30
    long = replace(
        touch(0),
        frames=frames[0],
        times=times,
        force=None,
        action=None,
        tracks={},
        image=frames[1],
        image_times=times + 0.01,
    )
    write_dataset([long], tmp_path / "set", LeRobotOptions())
    for one in frames:
        assert max(one.read_at_once) <= 32
        assert one.rows[-300:] == list(range(300))


class CountedFrames(ArrayFrames):
    """Frames with a log of the read indices."""

    def read(self, indices: Sequence[int]) -> NDArray[np.uint8]:
        noted = self.__dict__.setdefault("noted", [])
        noted.append(list(indices))
        return super().read(indices)

    @property
    def read_at_once(self) -> list[int]:
        return [len(rows) for rows in self.__dict__["noted"]]

    @property
    def rows(self) -> list[int]:
        return [row for rows in self.__dict__["noted"] for row in rows]


@pytest.mark.parametrize("fps", [15, 60])
def test_a_video_of_another_rate_than_the_metadata(tmp_path: Path, fps: int) -> None:
    root = tmp_path / "set"
    write_dataset([touch(0)], root, LeRobotOptions())
    path = root / "meta/info.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | {"fps": fps}))
    with pytest.raises(DataError, match=rf"its video comes 30 times a second, .*fps: {fps};"):
        all_of(root)


def test_rows_of_another_rate_than_the_metadata(tmp_path: Path) -> None:
    root = tmp_path / "set"
    write_dataset([touch(0)], root, LeRobotOptions())
    (root / folder.TOUCH).unlink()
    (path,) = (root / "data").glob("*/*.parquet")
    table = parquet.read_table(path)
    stamps = pa.array(np.arange(24, dtype=np.float32) * 33.3)
    at = table.column_names.index("timestamp")
    parquet.write_table(
        table.set_column(at, "timestamp", stamps).drop_columns(["observation.time.digit"])
        if "observation.time.digit" in table.column_names
        else table.set_column(at, "timestamp", stamps),
        path,
    )
    info = json.loads((root / "meta/info.json").read_text())
    info["features"].pop("observation.time.digit", None)
    (root / "meta/info.json").write_text(json.dumps(info))
    data = LeRobot(str(root), ["observation.images.digit"], ["digit"], val=0)
    with pytest.raises(DataError, match=r"timestamp comes 0\.03003 times a second, .*fps: 30;"):
        list(data.recordings("train"))


def bent_info(root: Path, change: Callable[[dict[str, Any]], object]) -> None:
    info = json.loads((root / folder.INFO).read_text())
    change(info)
    (root / folder.INFO).write_text(json.dumps(info))


@pytest.mark.parametrize("fps", [True, "30", None, 1e300, -30, float("nan"), 10**400, [30]])
def test_a_rate_that_is_none_is_named(tmp_path: Path, fps: object) -> None:
    write_dataset([touch(0)], tmp_path / "set", LeRobotOptions())
    bent_info(tmp_path / "set", lambda info: info.update(fps=fps))
    with pytest.raises(DataError, match=r"info\.json: .*fps|info\.json: not a LeRobot info file"):
        all_of(tmp_path / "set")


@pytest.mark.parametrize(
    "dtype", ["S1000000000", "U9", "O", ">f8", "complex64", "datetime64[s]", 3]
)
def test_types_of_features_are_of_a_list(tmp_path: Path, dtype: object) -> None:
    write_dataset([touch(0)], tmp_path / "set", LeRobotOptions())
    about = "observation.force.digit"
    bent_info(tmp_path / "set", lambda info: info["features"][about].update(dtype=dtype))
    with pytest.raises(DataError, match=rf"{about} is of dtype"):
        all_of(tmp_path / "set")


@pytest.mark.parametrize("shape", [[-1], [True], ["3"], [1 << 30], 3, None, [3.0]])
def test_shapes_of_features_are_sizes(tmp_path: Path, shape: object) -> None:
    write_dataset([touch(0)], tmp_path / "set", LeRobotOptions())
    about = "observation.force.digit"
    bent_info(tmp_path / "set", lambda info: info["features"][about].update(shape=shape))
    with pytest.raises(DataError, match=rf"{about} has the shape"):
        all_of(tmp_path / "set")


def test_names_and_digits_of_paths(tmp_path: Path) -> None:
    path = "{video_key:03d}/{chunk_index}/{chunk_index:3d}-{file_index:06d}.mp4"
    info = Info(30.0, {}, "", path)
    found = info.video_file(tmp_path, "a.b", {"chunk_index": 7, "file_index": 12})
    assert found == tmp_path / "a.b/7/007-000012.mp4"


def test_a_feature_of_a_type_that_is_not_read_is_no_fault(tmp_path: Path) -> None:
    write_dataset([touch(0)], tmp_path / "set", LeRobotOptions())
    other = {"observation.sound": {"dtype": "audio", "shape": [1], "names": None}}
    bent_info(tmp_path / "set", lambda info: info["features"].update(other))
    assert len(all_of(tmp_path / "set")) == 1


def test_a_device_without_a_feature_is_named(tmp_path: Path) -> None:
    root = tmp_path / "set"
    write_dataset([touch(0)], root, LeRobotOptions())
    held = json.loads((root / folder.TOUCH).read_text())
    held["episodes"][0]["paw"] = held["episodes"][0]["digit"]
    (root / folder.TOUCH).write_text(json.dumps(held))
    with pytest.raises(DataError, match=r"feature in meta/tactileforge.json .*images\.paw"):
        all_of(root)


@pytest.mark.slow
@pytest.mark.parametrize("name", [folder.INFO, folder.TOUCH])
def test_metadata_that_is_bent_is_named_or_read(tmp_path: Path, name: str) -> None:
    root, found = tmp_path / "set", {"named": 0, "read": 0}
    write_dataset([touch(0, frames=4)], root, LeRobotOptions(images="png"))
    whole = json.loads((root / name).read_text())
    for what, changed in list(bent(whole))[::2]:
        (root / name).write_text(json.dumps(changed))
        try:
            for one in LeRobot(str(root), val=0.0).recordings("train"):
                assert len(one.frames.read(range(len(one.frames)))) == 4, what
                assert one.background() is None or one.background().ndim == 3
            found["read"] += 1
        except TactileForgeError:
            found["named"] += 1
    assert min(found.values()) > 20


CELLS = (None, True, -1, 1 << 50, float("nan"), "x", [1], b"a", {"a": 1})


@pytest.mark.slow
@pytest.mark.parametrize("where", ["meta/episodes", "data", "meta"])
def test_tables_that_are_bent_are_named_or_read(tmp_path: Path, where: str) -> None:
    """Each column is dropped, renamed, and filled with cells of a different type."""
    import pyarrow

    root, named = tmp_path / "set", 0
    write_dataset([touch(0, frames=4)], root, LeRobotOptions(images="png"))
    (root / folder.TOUCH).unlink()
    options = {"touch": ["observation.images.digit"], "sensors": ["digit"]}
    options["force"] = ["observation.force.digit"]
    path = next(p for p in sorted(root.rglob("*.parquet")) if str(p.parent).find(where) > 0)
    table = parquet.read_table(path)
    for column in [name for name in table.column_names if not name.startswith("stats/")]:
        others = [table.drop_columns([column]), table.slice(0, 0)]
        others.append(
            table.rename_columns([f"{n}2" if n == column else n for n in table.column_names])
        )
        at = table.column_names.index(column)
        for cell in CELLS:
            cells = pyarrow.array([cell] * len(table))
            others.append(table.set_column(at, column, cells))
        for other in others:
            parquet.write_table(other, path)
            parquet_files.forget()
            try:
                for one in LeRobot(str(root), val=0.0, **options).recordings("train"):
                    one.frames.read(range(len(one.frames)))
            except TactileForgeError:
                named += 1
    assert named >= 3
