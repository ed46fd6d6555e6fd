"""The four tasks: byte-identical repeats, solved by the experts, with the documented failures."""

import warnings

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from tactileforge_depth.contact import NotConverged
from tactileforge_policies import envs

from tactileforge.errors import ConfigError


def made(task, **options):
    return gymnasium.make(envs.env_id(task), **{"size": 32, **options})


def played(env, seed, actions=None):
    """Plays an episode by the expert or given actions; returns observations, actions, infos."""
    seen, done = [env.reset(seed=seed)], []
    act, over = env.unwrapped.expert(), False
    while not over:
        action = act(None) if actions is None else actions[len(done)]
        *seen_now, ended, cut, info = env.step(action)
        seen.append((seen_now[0], info))
        done.append(action)
        over = ended or cut
    return seen, done


@pytest.mark.slow
@pytest.mark.parametrize("task", envs.TASKS)
def test_gymnasium_checks_the_environment(task):
    with warnings.catch_warnings():
        # Actions are in mm, as documented, not shares of a range.
        warnings.filterwarnings("ignore", message=".*normalized space.*")
        check_env(made(task, render_mode="rgb_array").unwrapped)


@pytest.mark.slow
@pytest.mark.parametrize("task", envs.TASKS)
def test_the_expert_succeeds_and_the_episode_repeats_to_the_byte(task):
    env = made(task)
    seen, done = played(env, 3)
    info = seen[-1][1]
    assert info["success"]
    assert info["score"] >= 0.95
    assert info["failure"] == ""
    scores = [one["score"] for _, one in seen]
    assert scores == sorted(scores), "the score never falls"
    again, _ = played(made(task), 3, done)
    for (left, _), (right, _) in zip(seen, again, strict=True):
        for name, value in left.items():
            np.testing.assert_array_equal(value, right[name])


@pytest.mark.slow
@pytest.mark.parametrize("task", envs.TASKS)
@pytest.mark.parametrize("sensor", ["digit", "gelsight_mini"])
def test_the_expert_succeeds_on_other_seeds(task, sensor):
    env = made(task, sensor=sensor)
    assert all(played(env, seed)[0][-1][1]["success"] for seed in range(100, 105))


def test_frames_show_the_touch_and_the_background_does_not():
    env = made("wipe")
    seen, _ = env.reset(seed=0)
    still = env.unwrapped.background()
    for finger in env.unwrapped.fingers:
        change = np.abs(seen[finger].astype(int) - still[finger])
        assert change.mean() > 2
    env = made("chip")
    seen, _ = env.reset(seed=0)
    still = env.unwrapped.background()
    assert np.abs(seen["left"].astype(int) - still["left"]).mean() < 1


def test_forces_of_the_fingers_are_mirror_images_and_not_observed():
    env = made("wipe")
    seen, info = env.reset(seed=0)
    left, right = info["force"]["left"], info["force"]["right"]
    np.testing.assert_array_equal(left * [-1, 1, 1], right)
    assert left[2] > 1
    assert set(seen) == {"left", "right", "image", "state"}


def pushed_on(env, until, action):
    """Repeats one action until the episode ends."""
    for _ in range(until):
        *_, ended, cut, info = env.step(np.array(action, np.float32))
        if ended or cut:
            break
    return info


@pytest.mark.parametrize("seed", [0, 1])
def test_a_chip_breaks_above_its_force_and_not_below(seed):
    env = made("chip")
    env.reset(seed=seed)
    act = env.unwrapped.expert()
    while env.unwrapped.held.normal < 0.5:
        env.step(act(None))
    before, info = 0.0, {"failure": ""}
    while not info["failure"]:
        before = env.unwrapped.held.normal
        *_, info = env.step(np.array([0, 0, -0.05], np.float32))
    assert info["failure"] == "crushed"
    assert before <= env.unwrapped.drawn["breaks"] < env.unwrapped.held.normal


@pytest.mark.slow
def test_a_chip_is_snapped_by_the_floor():
    env = made("chip")
    env.reset(seed=2)
    act = env.unwrapped.expert()
    while env.unwrapped.load(env.unwrapped.floor) < 0.3 or env.unwrapped.x < 15:
        env.step(act(None))
    assert pushed_on(env, 20, [0, -0.2, 0])["failure"] in ("snapped", "slipped")


def test_what_is_let_go_of_is_dropped():
    env = made("wipe")
    env.reset(seed=0)
    assert pushed_on(env, 20, [0, 0, 2])["failure"] == "dropped"


@pytest.mark.slow
def test_a_ball_in_the_wrong_box_is_no_success():
    env = made("grasp")
    env.reset(seed=0)
    plain = env.unwrapped
    act = plain.expert()
    while plain.z < 13.9 or plain.free:
        env.step(act(None))
    way = 1.5 if plain.soft else -1.5
    while way * plain.x < 1.5 * 16:
        env.step(np.array([way, 0, 0], np.float32))
    info = pushed_on(env, 20, [0, 0, 1])
    assert (info["failure"], info["success"]) == ("wrong box", False)


@pytest.mark.slow
def test_an_eraser_stalls_when_pressed_hard_and_misses_when_it_hovers():
    env = made("wipe")
    env.reset(seed=0)
    assert pushed_on(env, 60, [0, -0.5, 0])["failure"] == "stalled"
    env.reset(seed=0)
    info = pushed_on(env, 60, [3, 0, 0])
    assert (info["failure"], info["score"]) == ("missed", 0.0)


def test_an_idle_episode_times_out():
    env = made("chip", max_episode_steps=5, steps=5)
    env.reset(seed=0)
    assert pushed_on(env, 10, [0, 0, 0])["failure"] == "timeout"


@pytest.mark.parametrize("action", [[np.nan, 0, 0], [0, 0], 1.0, None])
def test_an_action_that_is_none_is_refused(action):
    env = made("chip")
    env.reset(seed=0)
    with pytest.raises(ConfigError, match=r"give \(3,\) finite numbers"):
        env.step(action)


def test_an_episode_that_the_solver_loses_says_so(monkeypatch):
    env = made("chip")
    env.reset(seed=0)

    def fails(*_):
        raise NotConverged("misfit")

    monkeypatch.setattr(env.unwrapped.grip, "close", fails)
    *_, ended, _, info = env.step(np.zeros(3, np.float32))
    assert (ended, info["failure"]) == (True, "unsolved")


def test_bad_options_are_named():
    with pytest.raises(ConfigError, match="digit"):
        made("chip", sensor="digt")
    with pytest.raises(ConfigError, match="size is 8"):
        made("chip", size=8)
    with pytest.raises(ConfigError, match="wipe"):
        envs.env_id("wippe")
