import numpy as np
import pytest
from tactileforge_sim.mechanics.motions import (
    FORCE_TRIAL,
    MOTIONS,
    Speeds,
    atomic,
    chain,
    force_trial,
)

from tactileforge.contracts import ACTIONS
from tactileforge.errors import ConfigError

START = (1.0, -0.5, 0.3, 0.01, 0.02)
SPEEDS = Speeds(depth=0.9, slide=2.0, turn=0.4, seconds=0.5, rest=0.2)


def middle(action: str) -> tuple[np.ndarray, np.ndarray]:
    """First and last pose of the phase of an action."""
    path = atomic(action, START, SPEEDS)
    phase = path.actions.index(action)
    return path.poses[phase], path.poses[phase + 1]


@pytest.mark.parametrize(
    ("action", "column", "way"),
    [
        ("slide_left", 0, -2.0),
        ("slide_right", 0, 2.0),
        ("slide_up", 1, -2.0),
        ("slide_down", 1, 2.0),
        ("rotate_cw", 2, 0.4),
        ("rotate_ccw", 2, -0.4),
    ],
)
def test_atomic_actions_go_their_way(action: str, column: int, way: float) -> None:
    before, after = middle(action)
    assert after[column] - before[column] == pytest.approx(way)
    others = [i for i in range(6) if i != column]
    np.testing.assert_allclose(after[others], before[others])
    assert before[3] == pytest.approx(0.9)
    np.testing.assert_allclose((before[:3] + after[:3]) / 2, START[:3])


def test_press_and_leave_go_in_and_out() -> None:
    before, after = middle("press")
    assert before[3] < 0 < after[3] == pytest.approx(0.9)
    before, after = middle("leave")
    assert after[3] < 0 < before[3] == pytest.approx(0.9)


@pytest.mark.parametrize("name", MOTIONS)
def test_paths_are_smooth_and_start_and_end_without_contact(name: str) -> None:
    path = MOTIONS[name](START, SPEEDS, np.random.default_rng(0))
    times = np.linspace(0, path.seconds, 2000)
    poses = path.pose(times)
    assert poses[0, 3] < 0 > poses[-1, 3]
    assert np.abs(np.diff(poses, axis=0)).max() < 0.02
    assert {"press", "leave"} <= set(path.actions)
    actions = path.action(times)
    if name in ACTIONS:
        assert ACTIONS.index(name) in actions
    assert actions[0] == -1
    # Outside of its time it stands still, and does nothing.
    np.testing.assert_array_equal(path.pose(np.array([-1.0, path.seconds + 1])), poses[[0, -1]])
    assert path.action(np.array([-1.0, path.seconds + 1])).tolist() == [-1, -1]


def test_force_trial_is_the_papers() -> None:
    path = force_trial(START, SPEEDS)
    assert tuple(a for a in path.actions if a != "stay") == FORCE_TRIAL
    pressed = path.poses[2:-2]
    np.testing.assert_allclose(pressed[0, :3], START[:3])
    np.testing.assert_allclose(pressed[-1, :3], START[:3])
    assert set(np.round(pressed[:, 1] - START[1], 6)) == {0.0, -2.0}


def test_mirror_swaps_left_and_right() -> None:
    for name, other in (("slide_left", "slide_right"), ("rotate_cw", "rotate_ccw")):
        path = atomic(name, START, SPEEDS).mirrored()
        mirrored = (-START[0], START[1], -START[2], -START[3], START[4])
        wanted = atomic(other, mirrored, SPEEDS)
        np.testing.assert_allclose(path.poses, wanted.poses, atol=1e-12)
        assert path.actions == wanted.actions


def test_manipulation_depends_on_its_seed_only() -> None:
    paths = [MOTIONS["manipulation"](START, SPEEDS, np.random.default_rng(s)) for s in (1, 1, 2)]
    np.testing.assert_array_equal(paths[0].poses, paths[1].poses)
    assert not np.array_equal(paths[0].poses, paths[2].poses)


def test_unknown_action_is_named() -> None:
    with pytest.raises(ConfigError, match="slide_rigth"):
        chain(("press", "slide_rigth"), START, SPEEDS)
    with pytest.raises(ConfigError, match="slid"):
        atomic("slid", START, SPEEDS)
