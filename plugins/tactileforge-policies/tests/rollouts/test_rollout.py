"""Rollouts: results by seed, their interval, resuming, and the page."""

import json
import math
import re
from pathlib import Path

import cv2
import numpy as np
import pytest
from tactileforge_policies.rollouts.options import (
    RolloutOptions,
    environment_id,
    make_environment,
)
from tactileforge_policies.rollouts.page import chosen_episodes, rollout_page
from tactileforge_policies.rollouts.results import EpisodeResult, wilson
from tactileforge_policies.rollouts.rollout import roll_out

from tactileforge import cli
from tactileforge.errors import ConfigError, TactileForgeError

TASK = "reach_env:Reach-v0"


def options(out, **given):
    own = {
        "task": TASK,
        "out": str(out),
        "policy": "expert",
        "size": 32,
        "processes": 1,
        "limit": 20,
    }
    return RolloutOptions(**own | given)


def outcome(folder):
    """Results without times."""
    plain = json.loads((Path(folder) / "results.json").read_text())
    return [{k: v for k, v in row.items() if "seconds" not in k} for row in plain["episodes"]]


@pytest.mark.parametrize(("successes", "count"), [(0, 20), (1, 20), (18, 20), (20, 20), (57, 100)])
def test_wilson_solves_its_equation(successes, count):
    """The ends are the shares p with |x/n - p| equal to 1.96 standard errors of p."""
    share = successes / count
    for end in wilson(successes, count):
        error = math.sqrt(end * (1 - end) / count)
        assert abs(share - end) == pytest.approx(1.959964 * error, abs=1e-6)


def test_the_expert_is_counted_by_kind_of_failure(tmp_path):
    done = roll_out(options(tmp_path / "r", n=10))
    assert done.summary.successes == 8
    assert done.summary.failures == {"crushed": 2}
    assert [e.seed for e in done.episodes if e.failure] == [3, 8]
    assert (done.summary.low, done.summary.high) == wilson(8, 10)
    assert done.summary.score == pytest.approx(np.mean([e.score for e in done.episodes]))
    assert done.summary.steps_per_second > 1


def test_a_task_that_never_ends_is_a_timeout(tmp_path):
    done = roll_out(options(tmp_path / "r", policy="still", n=3, limit=7))
    assert done.summary.failures == {"timeout": 3}
    assert [e.steps for e in done.episodes] == [7, 7, 7]
    assert all(e.force["right"] == [[0.1, 0.0, 0.0]] * 8 for e in done.episodes), "nothing moved"


def test_our_tasks_last_as_long_as_the_limit():
    given = {"task": "chip", "policy": "still"}
    assert make_environment(RolloutOptions(**given, limit=200)).unwrapped.steps == 200
    env = make_environment(RolloutOptions(**given, limit=200, env={"steps": 50}))
    assert env.unwrapped.steps == 50


def test_a_rollout_applies_the_gain_that_demonstrations_have(tmp_path, policy):
    """The policy gets backgrounds and presses with the label of a demonstration."""
    from tactileforge_policies.reference import GAIN_LABEL, reference_gain
    from tactileforge_policies.rollouts.actors import make_actor
    from tactileforge_policies.rollouts.demonstrations import pack_episode
    from tactileforge_policies.rollouts.episode import play_episode
    from tactileforge_policies.rollouts.options import DemonstrationOptions

    given = []
    policy.loaded.uses_reference = True
    policy.loaded.state_size = policy.loaded.action_size = 3
    policy.loaded.reset = lambda **words: given.append(words)
    policy.loaded.step = lambda *words: np.zeros(3, np.float32)
    made = DemonstrationOptions(task="chip", size=32, limit=2, out="", env={"unit": 4})
    env = make_environment(made)
    episode = play_episode(env, make_actor(policy.path, env), seed=7)
    (words,) = given
    for packed in pack_episode(episode, env, "chip_00000", made):
        labels = packed.head["labels"]
        name = labels["finger"]
        gain = reference_gain(words["background"][name], words["reference"][name], name)
        assert labels[GAIN_LABEL] == gain > 0


def test_a_task_without_reference_presses_is_named(tmp_path, policy):
    policy.loaded.uses_reference = True
    with pytest.raises(ConfigError, match=r"task reach has no reference\(\); train it with data"):
        roll_out(options(tmp_path / "r", policy=policy.path, n=2))


def test_a_policy_succeeds_by_touch(tmp_path, policy):
    done = roll_out(options(tmp_path / "r", policy=policy.path, n=10))
    assert done.summary.successes == 10
    policy.loaded.uses_force = True
    with pytest.raises(AssertionError):
        roll_out(options(tmp_path / "s", policy=policy.path, n=1))


@pytest.mark.slow
def test_seeds_are_the_same_for_all_and_processes_change_nothing(tmp_path, monkeypatch):
    monkeypatch.setenv("PYTHONPATH", str(Path(__file__).parents[1] / "helpers"))
    roll_out(options(tmp_path / "a", n=5))
    roll_out(options(tmp_path / "b", n=5, processes=2))
    assert outcome(tmp_path / "a") == outcome(tmp_path / "b")
    videos = [(tmp_path / f / "videos/00002.mp4").read_bytes() for f in "ab"]
    assert videos[0] == videos[1]


def test_killed_rollouts_go_on_and_more_are_added(tmp_path):
    roll_out(options(tmp_path / "a", n=6))
    roll_out(options(tmp_path / "b", n=3))
    (tmp_path / "b/episodes/00001.json").unlink()
    first = tmp_path / "b/episodes/00000.json"
    before = first.stat().st_mtime_ns
    roll_out(options(tmp_path / "b", n=6))
    assert outcome(tmp_path / "a") == outcome(tmp_path / "b")
    assert first.stat().st_mtime_ns == before


def test_a_folder_of_other_rollouts_is_refused(tmp_path, policy):
    roll_out(options(tmp_path / "a", n=1, policy=policy.path))
    Path(policy.path).write_bytes(b"others")
    with pytest.raises(ConfigError, match=r"other weights\)"):
        roll_out(options(tmp_path / "a", n=1, policy=policy.path))


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("fingers", ("left",), r"has fingers: \['left'\], but task reach has"),
        ("state_size", 5, "numbers of the state: 5, but task reach has 2"),
        ("action_size", 3, "numbers of an action: 3"),
        ("rate", 3.0, r"steps of a second: 3.0, but task reach has 6.0"),
        ("tasks", ("chip", "wipe"), "learned chip, wipe: give task=chip, or train it on reach"),
        ("sensor", ("gelsight", "gelsight"), "sensor=gelsight, or cross_sensor=true"),
    ],
)
def test_a_policy_that_does_not_fit_is_named_before(tmp_path, policy, name, value, message):
    setattr(policy.loaded, name, value)
    with pytest.raises(ConfigError, match=message):
        roll_out(options(tmp_path / "a", n=1, policy=policy.path))
    assert not (tmp_path / "a").exists()


def test_another_sensor_where_it_is_asked_for(tmp_path, policy):
    policy.loaded.sensor = ("gelsight", "gelsight")
    done = roll_out(options(tmp_path / "a", n=2, policy=policy.path, cross_sensor=True))
    assert done.summary.successes == 2


def test_an_action_that_is_no_number_is_named(tmp_path, policy):
    policy.loaded.step = lambda *_: np.array([np.nan, 1], np.float32)
    with pytest.raises(TactileForgeError, match=r"seed 0, step 0: the action \[nan, 1.0\]"):
        roll_out(options(tmp_path / "a", n=1, policy=policy.path))


def test_a_damaged_result_is_named(tmp_path):
    roll_out(options(tmp_path / "a", n=1))
    path = tmp_path / "a/episodes/00000.json"
    path.write_text(path.read_text().replace('"success": true', '"success": false'))
    with pytest.raises(TactileForgeError, match="remove it, and go on"):
        roll_out(options(tmp_path / "a", n=1))


def test_videos_show_the_episode(tmp_path):
    done = roll_out(options(tmp_path / "a", n=1))
    video = cv2.VideoCapture(str(tmp_path / "a" / done.episodes[0].video))
    frames = []
    while (read := video.read())[0]:
        frames.append(read[1])
    assert len(frames) == done.episodes[0].steps + 1
    assert frames[0].shape == (96, 3 * 96, 3)
    assert video.get(cv2.CAP_PROP_FPS) == pytest.approx(6)
    # the box of the camera brightens or darkens as the place changes; the left finger stays
    box = [float(frame[44:52, 44:52].mean()) for frame in frames]
    assert abs(box[-1] - box[0]) > 5
    finger = [float(frame[:, 100:190].mean()) for frame in frames]
    assert np.ptp(finger) < 3


def made_up(seed, success):
    end = {"failure": "" if success else "dropped", "success": success, "score": float(success)}
    force = {"left": [[0.0, 0.0, 1.0]]}
    return EpisodeResult(
        seed=seed, steps=1, seconds=1.0, act_seconds=0.5, times=[0.0], force=force, **end
    )


def test_failures_and_successes_are_shown_in_turn():
    episodes = [made_up(seed, success=seed not in (7, 9, 11)) for seed in range(20)]
    assert [e.seed for e in chosen_episodes(episodes, 4)] == [0, 1, 7, 9]
    assert [e.seed for e in chosen_episodes(episodes, 8)] == [0, 1, 2, 3, 4, 7, 9, 11]


def test_the_page_has_videos_forces_and_failures(tmp_path):
    done = roll_out(options(tmp_path / "a", n=5, shown=3))
    text = rollout_page(done)
    assert len(re.findall(r"<video src=\"data:video/mp4;base64,", text)) == 3
    assert "80 % (4 of 5)" in text
    assert "crushed" in text
    # two fingers by three axes, and one figure an episode shown
    assert text.count("<svg role") == 6 + 3


@pytest.mark.slow
def test_the_verbs(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    words = [f"task={TASK}", "size=32", "processes=1"]
    assert cli.run(["demos", *words, "n=4", "out=d"]) == 0
    out = capsys.readouterr().out
    assert "4 episodes: d" in out
    assert "left out, the expert failed in 1 of 5; seeds: 1000000003 crushed" in out
    assert cli.run(["rollout", *words, "policy=expert", "n=4", "limit=20"]) == 0
    out = capsys.readouterr().out
    low, high = wilson(3, 4)
    assert f"3 of 4 succeed, 75.0 % (95 % interval {100 * low:.1f} to {100 * high:.1f} %)" in out
    assert (tmp_path / "runs/rollouts/reach-digit-expert/report.html").is_file()
    assert cli.run(["rollout", *words, "policy=nobody"]) == 1
    assert "policy=nobody: neither expert nor still" in capsys.readouterr().err


def test_a_task_is_found_by_every_id_that_gymnasium_has():
    ours = environment_id("chip")
    assert environment_id(ours) == ours
    assert environment_id(f"tactileforge_policies.envs:{ours}") == ours
    assert environment_id("CartPole-v1") == "CartPole-v1"
    with pytest.raises(ConfigError, match=r"unknown task 'other/Chip-v0'"):
        environment_id("other/Chip-v0")
