"""``data lerobot`` and ``data embed`` as commands, and the data set as a plugin."""

import os
import subprocess
import sys

import pytest

from tactileforge import cli
from tactileforge.testing import check


@pytest.mark.parametrize("words", [["data", "lerobot"], ["data", "embed", "model=anytouch2.tiny"]])
def test_they_look_at_their_place_before_they_work(words, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "file").touch()
    assert cli.run([*words, "data=sim", "out=file/a.yaml"]) == 1
    err = capsys.readouterr().err
    assert err.count("\n") == 1
    assert "is a file, not a folder); give another out=" in err
    assert [path.name for path in tmp_path.rglob("*")] == ["file"]


def test_their_keys_are_told(capsys):
    assert cli.run(["data", "lerobot", "--help"]) == 0
    assert "tactileforge data lerobot data=NAME" in capsys.readouterr().out
    assert cli.run(["data", "embed", "data=sim", "model=m", "out=o", "--cfg", "job"]) == 0
    assert "images: camera" in capsys.readouterr().out


@pytest.mark.parametrize("verb", ["data.lerobot", "data.embed"])
def test_they_conform(verb):
    assert {result.status for result in check("verb", verb)} == {"ran"}


def test_the_data_set_needs_a_folder_and_says_so(capsys):
    assert cli.run(["plugins", "check", "lerobot", "--kind", "dataset"]) == 0
    out = capsys.readouterr().out
    assert "give options to check this: root=..." in out
    assert " 0 failed" in out


@pytest.mark.slow
def test_what_is_recorded_is_a_demonstration_in_lerobots_format(tmp_path, capsys):
    out = tmp_path / "demos"
    words = ["sensor=sim", "sensor.sim.size=32", "sensor.sim.type=digit", "robot=sim_robot"]
    words += ["robot.joints=2", "seconds=1.5", "background.seconds=0", "text=press", f"out={out}"]
    one = os.environ | {"OMP_NUM_THREADS": "1"}  # fast on a busy machine too
    command = [sys.executable, "-m", "tactileforge", "record", *words]
    done = subprocess.run(command, capture_output=True, text=True, env=one)
    assert done.returncode == 0, done.stderr
    data = ["data=shards", f"data.root={out}"]
    assert cli.run(["data", "lerobot", *data, f"out={tmp_path / 'set'}", "lerobot.fps=10"]) == 0
    said = capsys.readouterr().out
    assert "1 episodes" in said
    assert "features: observation.state, action" in said
    assert "trains no policy" not in said
