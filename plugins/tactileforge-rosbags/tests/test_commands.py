"""Bags on the command line: recognised, looked at, packed, and trained on."""

import csv

import numpy as np
import pytest
from made_bags import BEGIN, KINDS, RIG_MAP, Messages, picture, write, write_rig
from tactileforge_rosbags.dataset import Rosbags

from tactileforge import cli
from tactileforge.plugins.registry import build


@pytest.mark.parametrize("kind", KINDS)
def test_bags_are_recognised(kind, tmp_path):
    path = write_rig(tmp_path / "set/one", kind)
    for root in (tmp_path / "set", path):
        guess = Rosbags.recognise(root)
        assert guess is not None
        assert (guess.format, guess.options["root"]) == ("ROS bags", str(root))
        assert guess.options["topics"] == {}
        assert any("no topic is called touch" in line for line in guess.doubts)
    for foreign in (tmp_path / "gone", tmp_path):
        (tmp_path / "set").rename(tmp_path / ".hidden") if foreign == tmp_path else None
        assert Rosbags.recognise(foreign) is None


def test_touch_is_guessed_by_names_of_topics(tmp_path):
    make = Messages("mcap")
    names = ("/digit_left/image_raw", "/tactile/gelsight", "/finger/tactile", "/camera/color")
    rows = [(name, BEGIN + i, make.raw(BEGIN, picture(0))) for i, name in enumerate(names)]
    write(tmp_path / "one", "mcap", rows)
    guess = Rosbags.recognise(tmp_path)
    assert guess is not None
    topics = {one["topic"]: one["sensor"] for one in guess.options["map"]["touch"]}
    assert topics == dict(zip(sorted(names[:3]), ("digit", "digit", "gelsight"), strict=True))
    assert "camera: /camera/color is the view of the scene" in guess.doubts
    assert any(line.startswith("background: none is known") for line in guess.doubts)
    # pictures of the rig are taller than wide
    assert any(
        line.startswith("/finger/tactile: sensor: no name tells the type; digit only by the shape")
        for line in guess.doubts
    )


def test_pictures_of_a_topic_once_more_and_computed_ones_are_no_touch(tmp_path):
    make = Messages("mcap")
    names = (
        *("/GelSightMini/image_raw", "/GelSightMini/image_raw/compressed", "/GelSightMini/depth"),
        *("/finger_cam/image", "/wrist/color", "/wrist/color/compressedDepth"),
    )
    rows = [
        (
            name,
            BEGIN + i,
            (make.compressed if "compressed" in name else make.raw)(BEGIN, picture(0)),
        )
        for i, name in enumerate(names)
    ]
    write(tmp_path / "one", "mcap", rows)
    guess = Rosbags.recognise(tmp_path)
    assert guess is not None
    (touch,) = guess.options["map"]["touch"]
    assert touch == {"topic": "/GelSightMini/image_raw", "sensor": "gelsight_mini"}
    assert guess.options["map"]["camera"] == {"topic": "/finger_cam/image?"}
    assert any("left out: /GelSightMini/depth, /wrist/color" in line for line in guess.doubts)


def test_each_finger_has_the_wrench_of_its_side(tmp_path):
    make = Messages("mcap")
    step = 33_000_000
    names = ("/gripper/left/digit", "/gripper/right/digit")
    forces = {"/gripper/left_wrench": 1.0, "/gripper/right_wrench": -2.0, "/base/wrench": 50.0}
    rows = []
    for i in range(6):
        at = BEGIN + step * i
        rows += [(name, at, make.raw(at, picture(i))) for name in names]
        rows += [(one, at, make.wrench(at, (0.0, 0.0, i * z))) for one, z in forces.items()]
    write(tmp_path / "one", "mcap", rows)
    guess = Rosbags.recognise(tmp_path)
    assert guess is not None
    found = {one.key: one.force for one in Rosbags(**guess.options, val=0).recordings("train")}
    left, right = (
        next(force for key, force in found.items() if side in key) for side in ("left", "right")
    )
    assert left[-1, 2] == pytest.approx(5)
    assert right[-1, 2] == pytest.approx(10)
    assert any(line.startswith("wrenches are tracks (/base/wrench)") for line in guess.doubts)


@pytest.mark.parametrize(
    ("topic", "sign", "found"),
    [("/netft_data", 1, True), ("/ft/wrench", -1, True), ("/robot/tcp_wrench", 1, False)],
)
def test_the_only_wrench_beside_one_touch_is_its_force(topic, sign, found, tmp_path):
    make = Messages("mcap")
    step = 33_000_000
    rows = [
        ("/digit/image", BEGIN + step * i, make.raw(BEGIN + step * i, picture(i))) for i in range(6)
    ]
    rows += [
        (topic, BEGIN + step * i, make.wrench(BEGIN + step * i, (0.0, 0.5, sign * float(i))))
        for i in range(6)
    ]
    write(tmp_path / "one", "mcap", sorted(rows, key=lambda row: row[1]))
    guess = Rosbags.recognise(tmp_path)
    assert guess is not None
    (one,) = Rosbags(**guess.options, val=0).recordings("train")
    if found:
        np.testing.assert_allclose(one.force[:, 2], np.arange(6), atol=1e-6)
        assert any(line.startswith(f"force: {topic} is taken for") for line in guess.doubts)
    else:
        assert one.force is None
        assert any(line.startswith("wrenches are tracks") for line in guess.doubts)


def words(tmp_path, kind="mcap"):
    for i in range(2):
        write_rig(tmp_path / f"set/bag_{i}", kind)
    (tmp_path / "rig.yaml").write_text(RIG_MAP)
    root, map_ = tmp_path / "set", tmp_path / "rig.yaml"
    return ["data=rosbags", f"data.root={root}", f"data.map={map_}", "data.val=0"]


@pytest.mark.slow
def test_they_are_looked_at(tmp_path, capsys):
    page = tmp_path / "page.html"
    assert cli.run(["data", "inspect", *words(tmp_path), f"out={page}"]) == 0
    text = page.read_text()
    assert "times are the stamps of the headers" in text
    assert "bag_1/left" in text
    assert "4 recordings" in capsys.readouterr().out


@pytest.mark.slow
def test_they_are_looked_at_without_a_word(tmp_path, capsys, monkeypatch):
    make = Messages("ros1")
    rows = [
        ("/digit/image_raw", BEGIN + i * 4 * 10**7, make.raw(0, picture(i), "rgb8"))
        for i in range(12)
    ]
    write(tmp_path / "set/one", "ros1", rows)
    monkeypatch.chdir(tmp_path)
    assert cli.run(["data", "inspect", "set", "out=page.html"]) == 0
    said = capsys.readouterr().out
    assert "ROS bags" in said
    assert "/digit/image_raw is taken for touch of digit, by its name" in said


@pytest.mark.slow
def test_they_are_packed_and_read_back(tmp_path):
    command, out = words(tmp_path, "sqlite3"), tmp_path / "packed"
    assert cli.run(["data", "pack", *command, f"out={out}", "pack.processes=1"]) == 0
    old = Rosbags(str(tmp_path / "set"), map=str(tmp_path / "rig.yaml"), val=0)
    kept = {one.key: one for one in old.recordings("train")}
    new = build("datasets", {"name": "shards", "root": str(out)}).recordings("train")
    found = {one.key: one for one in new}
    assert found.keys() == kept.keys()
    assert len(found) == 4
    for key, one in found.items():
        assert {*one.tracks} == {*kept[key].tracks}
        assert (one.text, one.object, one.labels) == (
            kept[key].text,
            kept[key].object,
            kept[key].labels,
        )
        np.testing.assert_array_equal(one.times, kept[key].times)
    np.testing.assert_array_equal(found["bag_0/left"].force, kept["bag_0/left"].force)


@pytest.mark.slow
def test_they_are_trained_on_by_workers(tmp_path, monkeypatch):
    command = words(tmp_path)
    monkeypatch.chdir(tmp_path)
    run = ["scale=demo", "debug=steps", "batch.size=2", "objective=[pixel,diff]"]
    run += ["batch.workers=1", f"hydra.run.dir={tmp_path / 'run'}"]
    assert cli.run(["train", *command, *run]) == 0
    with open(next((tmp_path / "run").rglob("*.csv"))) as file:
        assert list(csv.DictReader(file))


def test_topics_on_the_command_line(tmp_path, capsys):
    command = words(tmp_path)[:2]
    out = f"out={tmp_path / 'page.html'}"
    assert cli.run(["data", "inspect", *command, "data.topics={/left/imag: digit}", out]) == 1
    said = capsys.readouterr().err.splitlines()[-1]
    assert "no topic of touch (/left/imag); topics of pictures: /left/image/compressed" in said
