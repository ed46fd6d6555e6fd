"""Presets, guesses, and the commands on data sets of others."""

from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from lerobot_recordings import touch
from lerobot_sets import LEFT, PRESSURE, ROWS, WRENCH, changed, columns, made_set, pictures
from omegaconf import OmegaConf
from tactileforge_lerobot import folder
from tactileforge_lerobot.dataset import LeRobot
from tactileforge_lerobot.options import LeRobotOptions
from tactileforge_lerobot.write import write_dataset
from test_numeric import deep_set, signal

from tactileforge import cli
from tactileforge.cli._compose import compose
from tactileforge.plugin import DataError, is_held_out
from tactileforge.plugins import registry


def built(*words: str) -> LeRobot:
    """The data set of a preset."""
    node = OmegaConf.to_container(compose("anytouch2", list(words)).data, resolve=True)
    return registry.build("datasets", {k: v for k, v in node.items() if k != "max_bad"})


def taf_set(root: Path, number: int, offset: float = 0.3, episodes: int = 2) -> Path:
    """One object: the first 30 rows are without contact; pressing is negative z."""
    parts, rows = [columns(n, 40) for n in range(episodes)], 40
    for one in parts:
        one[WRENCH][:, 2] = offset - np.linspace(0, 5, rows, dtype=np.float32)
    parts[0][WRENCH][:30, :3] = [0.1, -0.2, offset]
    numbers = {name: [one[name] for one in parts] for name in (WRENCH, PRESSURE)}
    videos = {LEFT: [pictures(0, 40, 24, 32) // 2 for _ in range(episodes)]}
    return made_set(root / f"gs_mini_obj{number}", "v3.0", "image", episodes, rows, numbers, videos)


def test_taf_has_forces_without_offset_and_is_split_by_object(tmp_path: Path) -> None:
    root = tmp_path / "gs_mini"
    for number in range(4):
        taf_set(root, number)
    words = ["data=taf", f"data.root={root}", f"taf.touch={LEFT}", "data.val=0.5"]
    data = built(*words)
    train, val = (list(data.recordings(split)) for split in ("train", "val"))
    assert data.skipped == []
    assert len(train) + len(val) == 8
    assert {one.object for one in train}.isdisjoint({one.object for one in val})
    for one in val:
        assert is_held_out(f"gs_mini/{one.object}", 0.5)
    assert data.provides == {"force", "object", "text"}
    one = (train + val)[1]
    assert one.key.endswith("/000001/tactile_left")
    assert (one.sensor, one.tier, one.object) == ("gelsight_mini", 1, one.key.split("/")[1])
    np.testing.assert_allclose(one.force[:, 2], np.linspace(0, 5, 40), atol=1e-5)
    wanted = columns(1, 40)[WRENCH][:, 0] - np.float32(0.1)
    np.testing.assert_allclose(one.force[:, 0], wanted, atol=1e-5)
    np.testing.assert_array_equal(one.tracks["pressure_matrix"], columns(1, 40)[PRESSURE])
    assert one.tracks["force_torque"].shape == (40, 6)
    first = (train + val)[0]
    np.testing.assert_array_equal(one.no_contact.read([0]), first.frames.read([0]))


def test_a_set_that_may_begin_in_contact_is_left_out(tmp_path: Path) -> None:
    root = tmp_path / "gs_mini"
    taf_set(root, 0)
    taf_set(root, 1, offset=0.6)
    data = built("data=taf", f"data.root={root}", f"taf.touch={LEFT}", "data.val=0")
    assert {one.object for one in data.recordings("train")} == {"gs_mini_obj0"}
    (line,) = data.skipped
    assert "the first 30 rows of observation.force_torque reach 0.6 along z" in line


def test_zero_rows_without_objects_are_those_of_each_episode(tmp_path: Path) -> None:
    root = made_set(tmp_path / "set", images="image")
    options: dict[str, Any] = {"touch": [LEFT], "sensors": ["digit"], "force": [WRENCH], "val": 0}
    for number, one in enumerate(LeRobot(str(root), force_tare=3, **options).recordings("train")):
        wrench = columns(number)[WRENCH][:, :3]
        np.testing.assert_allclose(one.force, wrench - np.median(wrench[:3], 0), atol=1e-6)


def test_daimon_finds_its_features_by_their_beginning(tmp_path: Path) -> None:
    root = deep_set(tmp_path / "all/one", signal(2 * ROWS), "gray16le", "gray16le")
    words = ["data=daimon", f"data.root={tmp_path / 'all'}", "data.val=0"]
    first, _ = built(*words, "daimon.touch=[observation.depth.*]").recordings("train")
    assert (first.key, first.sensor) == ("all/one/000000/depth.left", "dm")
    assert np.isnan(first.tracks["state"][1, 0])
    wanted = np.rint(128 + (signal(2 * ROWS)[0] - 30000.0) * 127 / 2000)
    assert np.abs(first.frames.read([0])[0, ..., 2] - wanted).max() <= 1
    with pytest.raises(DataError, match=r"data.touch 'observation.deformation.\*'"):
        list(built(*words[:1], f"data.root={root}", "data.val=0").recordings("train"))


def test_opentouch_is_drawn_by_the_span_given(tmp_path: Path) -> None:
    name = "observation.tactile_grid"
    values = np.random.default_rng(0).uniform(0, 9, (ROWS, 16, 16)).astype(np.float32)
    root = made_set(tmp_path / "set", "v2.0", episodes=1, numbers={name: [values]}, videos={})
    words = ["data=opentouch", f"data.root={root}", "data.val=0", "opentouch.span=9"]
    (one,) = built(*words).recordings("train")
    assert one.frames.shape == (16, 16)
    np.testing.assert_array_equal(one.tracks["taxels"][..., 0], values.reshape(ROWS, 256))


@pytest.mark.parametrize("version", ["v2.1", "v3.0"])
def test_pictures_of_touch_are_recognised_by_name(tmp_path: Path, version: str) -> None:
    root = made_set(tmp_path / "set", version, images="image")
    guess = LeRobot.recognise(root)
    assert guess is not None
    assert (guess.score, guess.options["root"]) == (1.0, str(root))
    assert guess.format == f"LeRobot {version[:2]} (10 rows a second)"
    assert guess.options["touch"] == [LEFT]
    assert guess.options["sensors"] == ["gelsight_mini"]
    assert guess.options["tracks"] == [PRESSURE, WRENCH]
    assert any("no name tells the type; gelsight_mini" in doubt for doubt in guess.doubts)
    assert any(f"{WRENCH} is a track; units, axes and signs" in doubt for doubt in guess.doubts)
    found = list(LeRobot(**guess.options, val=0).recordings("train"))
    assert len(found) == 2
    assert found[0].tracks["force_torque"].shape == (ROWS, 6)


def test_a_force_with_a_word_of_its_touch_is_recognised(tmp_path: Path) -> None:
    sides = {"left": np.linspace((0, 0, 0), (1, 2, 3), ROWS), "right": np.ones((ROWS, 3))}
    sides["right"][:, 2] = -2
    root = made_set(
        tmp_path / "set",
        "v2.1",
        images="image",
        episodes=1,
        videos={
            f"observation.images.{name}": [pictures(0)]
            for name in ("tactile_left", "tactile_left_depth", "tactile_right", "top")
        },
        numbers={
            "observation.tcp_wrench": [np.ones((ROWS, 6), np.float32)],
            **{
                f"observation.force_{side}": [values[:, ::-1].astype(np.float32)]
                for side, values in sides.items()
            },
        },
    )

    def name_axes(info: dict[str, Any]) -> None:
        for side in sides:
            info["features"][f"observation.force_{side}"]["names"] = ["fz", "fy", "fx"]

    changed(root, "meta/info.json", name_axes)
    guess = LeRobot.recognise(root)
    assert guess is not None
    assert guess.options["touch"] == [f"observation.images.tactile_{side}" for side in sides]
    assert guess.options["camera"] == "observation.images.top"
    assert guess.options["tracks"] == ["observation.tcp_wrench"]
    left, right = LeRobot(**guess.options, val=0).recordings("train")
    np.testing.assert_allclose(left.force, sides["left"], atol=1e-6)
    np.testing.assert_allclose(right.force, np.abs(sides["right"]), atol=1e-6)

    def unname(info: dict[str, Any]) -> None:
        for side in sides:
            info["features"][f"observation.force_{side}"]["names"] = None

    changed(root, "meta/info.json", unname)
    guess = LeRobot.recognise(root)
    assert guess is not None
    assert guess.options["force_columns"] == (0, 1, 2), "the first three are x, y and z"


@pytest.mark.parametrize(
    "shape", [(4, 4), (2, 21, 21), (2, 4, 3), (6, 6), (72, 64, 1), (52,), (2, 3, 4, 4)]
)
def test_numbers_of_touch_are_recognised_and_read(tmp_path: Path, shape: tuple[int, ...]) -> None:
    values = np.zeros((ROWS, *shape), np.float32)
    numbers = {"observation.tactile_grid": [values]}
    made_set(tmp_path / "a/set", "v2.0", episodes=1, numbers=numbers, videos={})
    guess = LeRobot.recognise(tmp_path / "a")
    assert guess is not None
    assert guess.options["sensors"] == ["serial_array"]
    assert any(doubt.startswith("span: ") for doubt in guess.doubts)
    assert len(list(LeRobot(**guess.options, val=0).recordings("train"))) == 1


def test_a_name_that_says_its_sensor_is_believed(tmp_path: Path) -> None:
    videos = {"observation.images.left_digit": [pictures(0)]}
    guess = LeRobot.recognise(made_set(tmp_path / "set", episodes=1, videos=videos))
    assert guess is not None
    assert guess.options["sensors"] == ["digit"]


def test_a_written_set_needs_no_options_and_other_folders_are_none(tmp_path: Path) -> None:
    write_dataset([touch(0)], tmp_path / "set", LeRobotOptions())
    guess = LeRobot.recognise(tmp_path / "set")
    assert guess is not None
    assert asdict(guess) == {
        "options": {"root": str(tmp_path / "set")},
        "format": "LeRobot v3 (30 rows a second)",
        "score": 1.0,
        "doubts": (),
    }
    (tmp_path / "other/meta").mkdir(parents=True)
    for text in ("", "[]", "{}", "\x00", '{"fps": 3}'):
        (tmp_path / "other" / folder.INFO).write_text(text)
        assert LeRobot.recognise(tmp_path / "other") is None
    assert LeRobot.recognise(tmp_path / "nowhere") is None
    assert LeRobot.recognise(tmp_path / "other" / folder.INFO) is None
    changed(tmp_path / "set", folder.INFO, lambda info: info.update(codebase_version="v1.6"))
    old = LeRobot.recognise(tmp_path / "set")
    assert old is not None
    assert "format v1.6, but only" in old.doubts[0]
    made_set(tmp_path / "plain", videos={"observation.images.front": [pictures(0)] * 2})
    (tmp_path / "plain/meta/info.json").write_text(
        (tmp_path / "plain/meta/info.json").read_text().replace("pressure", "voltage")
    )
    none = LeRobot.recognise(tmp_path / "plain")
    assert none is not None
    assert "no feature is touch by its name" in none.doubts[0]
    assert "observation.images.front" in none.doubts[0]


def commands(root: Path, out: Path, *words: str) -> None:
    """Inspects, packs and trains a few steps."""
    data = ["data=lerobot", f"data.root={root}", *words]
    assert cli.run(["data", "inspect", *data, f"out={out}/inspect.html"]) == 0
    assert "LeRobot data set set" in (out / "inspect.html").read_text()
    assert cli.run(["data", "pack", *data, f"out={out}/shards", "pack.processes=1"]) == 0
    steps = ["debug=steps", "scale=demo", "objective=[pixel]", "encoder.image_size=32"]
    steps += ["batch.workers=0", f"hydra.run.dir={out}/run"]
    assert cli.run(["train", *data, *steps]) == 0


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")
def test_the_commands_run_on_v21(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    videos = {LEFT: [pictures(n, 12, 48, 64) for n in range(6)]}
    root = made_set(tmp_path / "set", episodes=6, rows=12, videos=videos)
    words = [f"data.touch=[{LEFT}]", "data.sensors=[gelsight_mini]", "data.val=0.4"]
    commands(root, tmp_path, *words, f"data.tracks=[{PRESSURE}]", f"data.force=[{WRENCH}]")


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")
def test_the_commands_run_on_numeric_touch(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    root = made_set(tmp_path / "set", "v3.0", episodes=6, rows=12, videos={})
    words = [f"data.touch=[{PRESSURE}]", "data.sensors=[gelsight_mini]", "data.val=0.4"]
    commands(root, tmp_path, *words, "data.span=5.0")
