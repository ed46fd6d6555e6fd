import csv
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from tactileforge.contracts import ACTIONS
from tactileforge.data.labels.actions import label_actions

PRESS, LEAVE, LEFT, RIGHT, UP, DOWN = range(6)
FPS = 30.0

#: Seconds, force at their end (x, y, z), action meanwhile.
TRIAL = [
    (0.5, (0, 0, 0), -1),
    (1.0, (0, 0, 6), PRESS),
    (0.5, (0, 0, 6), -1),
    (1.0, (3, 0, 6), RIGHT),
    (0.5, (3, 0, 6), -1),
    (1.0, (-2, 0, 6), LEFT),
    (0.5, (-2, 0, 6), -1),
    (1.0, (-2, 3, 6), DOWN),
    (0.5, (-2, 3, 6), -1),
    (1.0, (-2, -1, 6), UP),
    (0.5, (-2, -1, 6), -1),
    (0.5, (0, 0, 0), LEAVE),
    (0.5, (0, 0, 0), -1),
]


def trial(fps: float = FPS) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.int64]]:
    """Times, forces along `TRIAL` in straight lines, true actions."""
    ends = np.cumsum([seconds for seconds, _, _ in TRIAL])
    times = np.arange(0, ends[-1], 1 / fps)
    knots = np.array([(0, 0, 0), *(force for _, force, _ in TRIAL)], float)
    force = np.stack([np.interp(times, [0, *ends], knots[:, i]) for i in range(3)], axis=1)
    truth = np.array([action for _, _, action in TRIAL])[np.searchsorted(ends, times, "right")]
    return times, force, truth


def segments(actions: NDArray[np.int64]) -> list[int]:
    """The labelled segments in order, each once."""
    changed = np.flatnonzero(np.diff(actions, prepend=-2))
    return [int(actions[i]) for i in changed if actions[i] >= 0]


def inner(truth: NDArray[np.int64], margin: int = 4) -> NDArray[np.bool_]:
    """Frames further than a few frames from a change."""
    changed = np.flatnonzero(np.diff(truth))
    near = [np.abs(np.arange(len(truth)) - i) <= margin for i in changed]
    return ~np.any(near, axis=0)


@pytest.mark.parametrize("fps", [18.0, 30.0, 60.0])
def test_known_truth(fps: float) -> None:
    times, force, truth = trial(fps)
    actions = label_actions(times, force)
    assert actions.dtype == np.int64
    assert segments(actions) == [PRESS, RIGHT, LEFT, DOWN, UP, LEAVE]
    sure = inner(truth, margin=round(0.15 * fps))
    np.testing.assert_array_equal(actions[sure], truth[sure])


@pytest.mark.parametrize("seed", range(5))
def test_noise(seed: int) -> None:
    times, force, truth = trial()
    noisy = force + np.random.default_rng(seed).normal(0, 0.06, force.shape)
    actions = label_actions(times, noisy)
    labelled = actions >= 0
    assert (actions[labelled & inner(truth)] == truth[labelled & inner(truth)]).mean() > 0.98
    moving = (truth >= 0) & inner(truth)
    assert (actions[moving] == truth[moving]).mean() > 0.9


def test_noise_alone_has_no_action() -> None:
    rng = np.random.default_rng(0)
    times = np.arange(300) / FPS
    steady = np.array([0.5, -0.3, 4.0]) + rng.normal(0, 0.05, (300, 3))
    assert (label_actions(times, steady) == -1).all()


def test_mirrored_forces_have_mirrored_actions_exactly() -> None:
    times, force, _ = trial()
    noisy = force + np.random.default_rng(3).normal(0, 0.05, force.shape)
    actions = label_actions(times, noisy)
    for axis, pair in ((0, (LEFT, RIGHT)), (1, (UP, DOWN))):
        sign = np.ones(3)
        sign[axis] = -1
        want = actions.copy()
        want[actions == pair[0]], want[actions == pair[1]] = pair[1], pair[0]
        np.testing.assert_array_equal(label_actions(times, noisy * sign), want)


def test_scale_and_start_of_time_do_not_matter() -> None:
    times, force, _ = trial()
    actions = label_actions(times, force)
    np.testing.assert_array_equal(label_actions(times + 64, force * 4), actions)


def test_between_two_axes_is_ambiguous() -> None:
    times = np.arange(60) / FPS
    ramp = np.linspace(0, 3, 60)
    diagonal = np.stack([ramp, ramp, np.full(60, 5.0)], axis=1)
    assert (label_actions(times, diagonal) == -1).all()
    along = diagonal * [1, 0.3, 1]
    assert (label_actions(times, along)[5:-5] == RIGHT).all()


def test_no_contact_has_no_action() -> None:
    times, force, _ = trial()
    force[:, 2] = 0
    assert (label_actions(times, force) == -1).all()
    assert (label_actions(times, np.zeros_like(force)) == -1).all()


def test_missing_forces() -> None:
    times, force, truth = trial()
    force[40:55] = np.nan
    force[100, 1] = np.nan
    actions = label_actions(times, force)
    assert (actions[40:55] == -1).all()
    assert actions[100] == -1
    sure = inner(truth) & (actions >= 0)
    np.testing.assert_array_equal(actions[sure], truth[sure])
    assert (label_actions(times, np.full_like(force, np.nan)) == -1).all()


@pytest.mark.parametrize("count", [0, 1, 2, 3])
def test_short_recordings(count: int) -> None:
    force = np.ones((count, 3)) * np.arange(count)[:, None]
    assert label_actions(np.arange(count) / FPS, force).tolist() == [-1] * count


@pytest.mark.realdata
@pytest.mark.parametrize(
    ("name", "columns", "sign", "slides"),
    [
        ("digit", ("fx_n", "fy_n", "fz_n"), (-1, 1, -1), [DOWN, UP, DOWN, RIGHT, LEFT, RIGHT]),
        ("gelsight_mini", ("fy_n", "fx_n", "fz_n"), (1, 1, -1), [RIGHT, LEFT, RIGHT, UP, DOWN, UP]),
    ],
)
def test_public_trials(
    realdata: Path, name: str, columns: tuple[str, ...], sign: tuple[int, ...], slides: list[int]
) -> None:
    """One trial each: press, slides to four sides and back, lift."""
    with (realdata / "touchd_force_demo" / f"{name}_force.csv").open() as file:
        rows = [[float(row[key]) for key in columns] for row in csv.DictReader(file)]
    actions = label_actions(np.arange(len(rows)) / FPS, np.array(rows) * sign)
    order = segments(actions)
    assert (order[0], order[-1]) == (PRESS, LEAVE)
    assert {LEFT, RIGHT, UP, DOWN} <= set(order)
    assert not set(order) & {ACTIONS.index("rotate_cw"), ACTIONS.index("rotate_ccw")}
    long = [action for action in order if (actions == action).sum() > 20]
    remaining = iter(long)
    assert all(action in remaining for action in slides), f"{slides} in this order within {long}"
    assert 0.4 < (actions >= 0).mean() < 0.8
