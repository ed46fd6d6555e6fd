"""Demonstrations of the expert: the format, the seeds, and the stored episodes."""

import os
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from tactileforge_policies.rollouts import demonstrations
from tactileforge_policies.rollouts.demonstrations import write_demonstrations
from tactileforge_policies.rollouts.options import DemonstrationOptions, TaskOptions

from tactileforge.datasets.shards import Shards
from tactileforge.errors import ConfigError, TactileForgeError

TASK = "reach_env:Reach-v0"


def options(out, **given):
    return DemonstrationOptions(
        **{"task": TASK, "out": str(out), "size": 32, "processes": 1, "noise": 0.0} | given
    )


def contents(folder):
    return {p.name: p.read_bytes() for p in Path(folder).glob("*.tar")}


def test_episodes_are_recordings_of_each_finger(tmp_path):
    made = write_demonstrations(options(tmp_path / "d", n=10))
    assert made.episodes == 10
    recordings = [
        r for split in ("train", "val") for r in Shards(str(tmp_path / "d")).recordings(split)
    ]
    assert len(recordings) == 20
    left, right = recordings[:2]
    assert left.key == "reach_00000/left"
    assert right.key == "reach_00000/right"
    assert left.labels == {
        "episode": "reach_00000",
        "task": "reach",
        "seed": 1e9,
        "success": 1.0,
        "finger": "left",
    }
    assert left.text == "move to the place that the finger feels"
    assert left.period == pytest.approx(1 / 6)
    steps = len(left.times)
    for recording in (left, right):
        assert (
            recording.tracks["state"].shape == recording.tracks["robot_action"].shape == (steps, 2)
        )
        assert (
            recording.tracks["state"].dtype == recording.tracks["robot_action"].dtype == np.float32
        )
        np.testing.assert_array_equal(recording.background(), np.full((32, 32, 3), 128))
    # A state is the one before the action, so the place is the sum of the earlier moves.
    places = left.tracks["state"][:, 0]
    moves = np.cumsum(left.tracks["robot_action"][:, 0])
    np.testing.assert_allclose(places, [0, *moves[:-1]], atol=1e-5)
    np.testing.assert_allclose(right.force[:, 2], abs(places), atol=1e-5)
    assert right.image is None
    np.testing.assert_array_equal(left.image_times, left.times)
    assert left.image.shape == (96, 96)


def test_noise_moves_the_arm_and_what_the_expert_meant_is_written_down(tmp_path):
    write_demonstrations(options(tmp_path / "d", n=6, noise=0.05))
    missed = []
    for recording in Shards(str(tmp_path / "d")).recordings("train"):
        places, meant = recording.tracks["state"][:, 0], recording.tracks["robot_action"][:, 0]
        # The finger's picture shows the goal, to 0.1.
        goal = (recording.frames.read([0])[0, 0, 0, 0] - 128.0) / 10
        if recording.labels["finger"] == "left":
            np.testing.assert_allclose(meant, np.clip(goal - places, -2, 2), atol=0.1)
            missed += [*(np.diff(places) - meant[:-1])]
    # 0.05 of the largest action, 10
    assert len(missed) > 20
    assert 0.35 < np.std(missed) < 0.65


def test_failures_are_left_out_and_named(tmp_path):
    made = write_demonstrations(options(tmp_path / "d", n=8))
    assert made.failed == {1_000_000_003: "crushed", 1_000_000_008: "crushed"}
    assert len(contents(tmp_path / "d")) == made.episodes == 8


@pytest.mark.slow
def test_same_seed_same_bytes_with_any_number_of_processes(tmp_path, monkeypatch):
    monkeypatch.setenv("PYTHONPATH", str(Path(__file__).parents[1] / "helpers"))
    write_demonstrations(options(tmp_path / "a", n=6))
    write_demonstrations(options(tmp_path / "b", n=6, processes=2))
    assert contents(tmp_path / "a") == contents(tmp_path / "b")
    write_demonstrations(options(tmp_path / "c", n=6, seed=1))
    assert not set(contents(tmp_path / "a").values()) & set(contents(tmp_path / "c").values())


@pytest.mark.slow
def test_a_faint_reference_press_costs_no_demonstration():
    rest = np.full((8, 8, 3), 100, np.uint8)
    episode = SimpleNamespace(background={"left": rest})
    press = SimpleNamespace(reference=lambda: {"left": rest + 24})
    assert demonstrations._gains(episode, press) == {"left": {"reference_gain": 2.0}}
    with pytest.warns(UserWarning, match="no label reference_gain: .* changes the picture by 0 "):
        assert (
            demonstrations._gains(episode, SimpleNamespace(reference=lambda: {"left": rest})) == {}
        )
    assert demonstrations._gains(episode, SimpleNamespace()) == {}


@pytest.mark.slow
def test_units_take_turns(tmp_path, monkeypatch):
    monkeypatch.setenv("PYTHONPATH", str(Path(__file__).parents[1] / "helpers"))
    write_demonstrations(options(tmp_path / "a", n=6, units=[0, 30]))
    write_demonstrations(options(tmp_path / "b", n=6, units=[0, 30], processes=2))
    assert contents(tmp_path / "a") == contents(tmp_path / "b")
    rests = {
        recording.labels["episode"][-1]: int(recording.no_contact.read([0]).max())
        for recording in Shards(str(tmp_path / "a")).recordings("train")
    }
    # the episode of number 3 fails
    assert rests == {"0": 128, "1": 158, "2": 128, "4": 128, "5": 158, "6": 128}


def test_a_killed_command_goes_on(tmp_path):
    write_demonstrations(options(tmp_path / "a", n=6))
    whole = contents(tmp_path / "a")
    for name in ("episode-00001.tar", "episode-00005.tar", "index.json"):
        (tmp_path / "a" / name).unlink()
    kept = tmp_path / "a" / "episode-00000.tar"
    before = kept.stat().st_mtime_ns
    write_demonstrations(options(tmp_path / "a", n=6))
    assert contents(tmp_path / "a") == whole
    assert kept.stat().st_mtime_ns == before, "what is there is not made again"
    with pytest.raises(ConfigError, match=r"other seed\); give another out="):
        write_demonstrations(options(tmp_path / "a", n=6, seed=1))


def test_shards_of_something_else_stay(tmp_path):
    (tmp_path / "index.json").write_text("{}")
    with pytest.raises(ConfigError, match="holds shards of something else; give another out="):
        write_demonstrations(options(tmp_path, n=1))
    assert (tmp_path / "index.json").read_text() == "{}"
    (tmp_path / "index.json").rename(tmp_path / "train-000000.tar")
    with pytest.raises(ConfigError, match="holds shards of something else; give another out="):
        write_demonstrations(options(tmp_path, n=1))


def test_seeds_are_not_those_of_rollouts(tmp_path):
    rollouts = {TaskOptions(task="x", seed=s).episode_seed(99_999) for s in (0, 9_999)}
    first = options(tmp_path).episode_seed(0)
    assert max(rollouts) < first


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"task": "reach_env:Raech-v0"}, "no such environment"),
        ({"task": "no_such_module:Reach-v0"}, "no such environment"),
        ({"task": "chpi"}, "unknown task 'chpi'; did you mean 'chip'"),
        ({"env": {"tempo": 1}}, "tempo"),
        ({"n": 0}, "n=0"),
        ({"codec": "gif"}, "codec=gif"),
        ({"seed": -1}, "seed=-1"),
        ({"units": []}, r"units=\[\]: give one or more"),
        ({"units": [1], "env": {"unit": 2}}, "env.unit= not beside it"),
        ({"limit": 0}, "limit=0"),
    ],
)
def test_mistakes_leave_nothing(given, message, tmp_path):
    with pytest.raises(ConfigError, match=message):
        write_demonstrations(options(tmp_path / "d", **given))
    assert not (tmp_path / "d").exists()


def test_an_expert_that_mostly_fails_is_an_error(tmp_path):
    with pytest.raises(TactileForgeError, match=r"failed in 13 of 13 episodes \(crushed 13\)"):
        write_demonstrations(options(tmp_path / "d", n=1, env={"hopeless": True}))


@pytest.mark.slow
def test_an_episode_that_is_damaged_is_played_anew(tmp_path, caplog):
    """Repairs a flipped bit, a truncated file and a damaged note, to the same bytes as before."""
    write_demonstrations(options(tmp_path, n=6))
    before = contents(tmp_path)
    first, second = sorted(tmp_path.glob("episode-*.tar"))[:2]
    raw = bytearray(first.read_bytes())
    raw[len(raw) // 2] ^= 1
    first.write_bytes(raw)
    second.write_bytes(second.read_bytes()[:3000])
    part = tmp_path / ".episode-00000.tar.x-1.abc.part"
    part.touch()
    os.utime(part, (0, 0))
    write_demonstrations(options(tmp_path, n=6))
    assert contents(tmp_path) == before
    assert f"{first}: damaged, so it is made anew" in caplog.text
    assert f"{second}: damaged, so it is made anew" in caplog.text
    assert "removed 1 part of a file that a stopped command had left" in caplog.text
