"""``tactileforge live`` from its words to its lines."""

import json
from dataclasses import fields

import cv2
import numpy as np
import pytest
from tactileforge_live.session import LiveOptions
from tactileforge_live.verbs.live import COMMANDS

from tactileforge.cli import run
from tactileforge.errors import ConfigError


def composed(*words):
    return COMMANDS[""].compose("live", ["sensor=sim", *words])


@pytest.fixture
def words(tmp_path):
    """A replay of moving pictures."""
    rng = np.random.default_rng(0)
    for number in range(6):
        cv2.imwrite(str(tmp_path / f"{number}.png"), rng.integers(90, 140, (32, 24, 3)))
    replay = {"path": tmp_path, "type": "digit", "loop": "true"}
    return [
        "sensor=replay",
        *(f"sensor.replay.{key}={value}" for key, value in replay.items()),
        "background.seconds=0",
    ]


def test_json_alone_goes_to_standard_output(words, capsys):
    assert run(["live", *words, "json=true", "frames=4"]) == 0
    captured = capsys.readouterr()
    lines = [json.loads(line) for line in captured.out.splitlines()]
    assert [line["sensor"] for line in lines] == ["replay"] * 4
    assert [line["contact"] for line in lines if line["frame"] == 1] in ([], [False])
    assert "page: http://127.0.0.1:" in captured.err
    assert "readings: replay 4 (skipped " in captured.err


def test_it_ends_after_its_seconds(words, capsys):
    assert run(["live", *words, "page=false", "seconds=0.5"]) == 0
    assert "readings: replay" in capsys.readouterr().out


def test_errors_are_said(words, capsys):
    assert run(["live", "sensor=replay"]) == 1
    assert "the replay sensor has no path" in capsys.readouterr().err
    assert run(["live", *words, "publish=[zm]"]) == 1
    assert "unknown publisher 'zm'" in capsys.readouterr().err
    assert run(["live", *words, "model=file:nothing.safetensors"]) == 1
    assert "nothing.safetensors: no such file" in capsys.readouterr().err


def test_help_lists_the_keys(capsys):
    assert run(["live", "--help"]) == 0
    printed = capsys.readouterr().out
    assert all(f"\n{key}:" in printed for key in composed())


@pytest.mark.parametrize(
    ("word", "message"),
    [
        ("+contact.on=3", "unknown key of contact 'on'"),
        ("contact.end=30", "give 0 < end <= begin"),
        ("slip.drop=2", "drop between 0 and 1"),
        ("+background.second=3", "did you mean 'seconds'"),
        ("frames=0", "frames=0: give a value above 0"),
    ],
)
def test_values_that_do_not_fit(word, message):
    with pytest.raises(ConfigError, match=message):
        COMMANDS[""].build(composed(word))


def test_defaults_are_those_of_the_class():
    built, wanted = COMMANDS[""].build(composed()), LiveOptions()
    for spec in fields(LiveOptions):
        assert getattr(built, spec.name) == getattr(wanted, spec.name)


@pytest.mark.parametrize("port", [99999, -1])
def test_a_port_that_cannot_be_is_named_before_anything_is_opened(words, capsys, port):
    assert run(["live", *words, f"port={port}"]) == 1
    error = capsys.readouterr().err.strip().splitlines()
    assert error[-1] == f"error: port={port}: give 1 to 65535, or 0 for any that is free"
    assert "page:" not in "".join(error)
