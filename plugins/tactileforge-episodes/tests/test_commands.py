"""The data set on the command line: looked at, packed, and trained on."""

import csv
import json
from html import unescape

import pytest
from made_episodes import FORMATS, aloha, open_x_tactile
from omegaconf import OmegaConf
from tactileforge_episodes.dataset import Episodes

from tactileforge import cli
from tactileforge.cli._compose import compose
from tactileforge.plugins.registry import build
from tactileforge.testing import check


def words(preset, root):
    """Words of a command for a made file."""
    out = [f"data={preset}", f"data.root={root}", "data.val=0"]
    for key, value in FORMATS[preset][1].items():
        inner = (
            ",".join(f"{name}: {what}" for name, what in value.items()) if key == "sensors" else 0
        )
        out.append(f"data.{key}={{{inner}}}" if inner else f"data.{key}={value}")
    return out


def composed(words):
    """The data set of a command."""
    data = OmegaConf.to_container(compose("anytouch2", words).data)
    return build("datasets", {key: data[key] for key in data if key != "max_bad"})


@pytest.mark.parametrize("preset", FORMATS)
def test_every_preset_is_an_option(preset, tmp_path):
    FORMATS[preset][0](tmp_path)
    data = composed(words(preset, tmp_path))
    assert isinstance(data, Episodes)
    assert list(data.recordings("train"))


@pytest.mark.slow
@pytest.mark.parametrize("preset", ["open_x_tactile", "univtac", "htt", "touch_in_the_wild"])
def test_it_is_looked_at(preset, tmp_path, capsys):
    FORMATS[preset][0](tmp_path / "set")
    page = tmp_path / "page.html"
    assert cli.run(["data", "inspect", *words(preset, tmp_path / "set"), f"out={page}"]) == 0
    said = capsys.readouterr().out
    kept = Episodes(str(tmp_path / "set"), preset=preset, val=0, **FORMATS[preset][1])
    assert len(list(kept.recordings("train"))) > 1
    text = unescape(page.read_text())
    assert kept.notes
    vanished = "leave the key out of the map"  # those of one kind are one line of the page
    absent = [note for note in kept.notes if note.partition(": ")[2][:30] not in text]
    assert [note for note in absent if vanished not in note] == []
    assert (vanished in text) == any(vanished in note for note in kept.notes)
    assert "recordings" in said


@pytest.mark.slow
@pytest.mark.parametrize("preset", ["open_x_tactile", "univtac", "htt", "manifeel"])
def test_it_is_packed_and_read_back(preset, tmp_path):
    FORMATS[preset][0](tmp_path / "set")
    out = tmp_path / "packed"
    command = ["data", "pack", *words(preset, tmp_path / "set"), f"out={out}", "pack.processes=1"]
    assert cli.run(command) == 0
    old = {
        one.key: one
        for one in Episodes(
            str(tmp_path / "set"), preset=preset, val=0, **FORMATS[preset][1]
        ).recordings("train")
    }
    new = {
        one.key: one
        for one in build("datasets", {"name": "shards", "root": str(out)}).recordings("train")
    }
    assert new.keys() == old.keys()
    for key, one in new.items():
        assert {*one.tracks} == {*old[key].tracks}
        assert (one.text, one.object, one.licence) == (
            old[key].text,
            old[key].object,
            old[key].licence,
        )
        assert len(one.frames) == len(old[key].frames)
    assert json.loads((out / "index.json").read_text())


@pytest.mark.slow
@pytest.mark.parametrize("preset", ["open_x_tactile", "univtac", "htt"])
def test_it_is_trained_on(preset, tmp_path, monkeypatch):
    FORMATS[preset][0](tmp_path / "set")
    monkeypatch.chdir(tmp_path)
    run = ["scale=demo", "debug=steps", "batch.size=2", "objective=[pixel,diff]"]
    command = ["train", *words(preset, tmp_path / "set"), *run, f"hydra.run.dir={tmp_path / 'run'}"]
    assert cli.run(command) == 0
    with open(next((tmp_path / "run").rglob("*.csv"))) as file:
        assert list(csv.DictReader(file))


def test_the_command_line_says_what_is_missing(tmp_path, capsys):
    aloha(tmp_path)
    command = [
        "data",
        "inspect",
        "data=aloha",
        f"data.root={tmp_path}",
        f"out={tmp_path / 'p.html'}",
    ]
    assert cli.run([*command, "data.sensors={any: digit}"]) == 1
    err = capsys.readouterr().err.splitlines()[-1]
    assert "has no times; give its rate: data.fps=" in err


def test_a_map_of_a_user_on_the_command_line(tmp_path):
    open_x_tactile(tmp_path)
    lines = ["about: mine", "ends: meta/episode_ends", "fps: 10", "touch:"]
    lines.append("  - {array: data/camera_main_rgb, sensor: digit}")
    (tmp_path / "mine.yaml").write_text("\n".join(lines))
    words = ["data=episodes", f"data.root={tmp_path}", f"data.map={tmp_path / 'mine.yaml'}"]
    assert len(list(composed([*words, "data.val=0"]).recordings("train"))) == 3


def test_the_format_is_recognised_where_none_is_named(tmp_path):
    open_x_tactile(tmp_path, seconds=True)
    data = composed(["data=episodes", f"data.root={tmp_path}", "data.val=0"])
    assert len(list(data.recordings("train"))) == 6
    assert "recognised as Open X-Tactile (OXT), zarr" in data.notes[0]
    assert "3 episodes were found, 0 of them held out; data.preset says another" in data.notes[0]
    assert f"tactileforge data inspect {tmp_path}" in data.notes[0]


def test_the_plugin_conforms():
    results = check("dataset", "episodes")
    assert not [one for one in results if one.status == "failed"]
