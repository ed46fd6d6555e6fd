"""Forces of the world on a held object."""

import numpy as np
import pytest
from tactileforge_policies.envs.insert import sockets
from tactileforge_policies.envs.outer import Slot, Solid, ground, placed, pushed

POINTS = np.array([[-2.0, 5.0], [0.0, 6.0], [2.0, 5.0]])


def floor(friction=0.4):
    return Solid(POINTS, ground(lambda x: 0.05 * x), 3.0, friction)


def test_a_point_is_pushed_out_in_proportion_to_its_depth():
    solid = floor()
    force, _ = solid.push(np.array([[0.0, 0.2], [1.0, -0.3], [2.0, 0.1]]))
    np.testing.assert_allclose(force[:, 1], -3.0 * np.array([0.2, 0.0, 0.2]), atol=1e-12)


def test_friction_grows_to_its_bound_and_stays_there():
    solid = floor(friction=0.4)
    places = np.array([[0.0, 0.2], [0.0, 0.2], [0.0, 0.2]])
    solid.settle(places)
    pulls = [solid.push(places + np.array([dx, 0]))[0][0, 0] for dx in (0.01, 0.04, 0.5, 2.0)]
    loads = 3.0 * (0.2 + 0.05 * np.array([0.01, 0.04, 0.5, 2.0]))
    np.testing.assert_allclose(pulls[:2], [-0.03, -0.12], atol=1e-9)
    np.testing.assert_allclose(pulls[2:], -0.4 * loads[2:], atol=1e-9)


def test_what_slipped_pulls_back_with_no_more_than_friction():
    solid = floor()
    solid.settle(np.array([[0.0, 0.2]] * 3))
    moved = np.array([[1.0, 0.2]] * 3)
    before, _ = solid.push(moved)
    solid.settle(moved)
    np.testing.assert_allclose(solid.push(moved)[0], before, atol=1e-12)


def test_a_slot_holds_up_to_its_force():
    slot = Slot(lambda place: 0.5 if place[1] > -1 else 0.0, 10.0)
    slot.settle(np.array([[0.0, 0.0]]))
    assert slot.push(np.array([[0.0, -0.03]]))[0][0] == pytest.approx([0, 0.3])
    assert slot.push(np.array([[-3.0, -4.0]]))[0][0] == pytest.approx([0.3, 0.4])
    slot.settle(np.array([[0.0, -9.0]]))
    assert not slot.push(np.array([[0.0, -9.5]]))[0].any()


@pytest.mark.parametrize("slide", [0.01, 0.6])
def test_the_slope_is_the_derivative_of_the_wrench(slide):
    # Independent of the formulas: central differences, sticking and slipping.
    outer = [Solid(POINTS, ground(lambda x: 0 * x), 3.0, 0.4), Slot(lambda place: 0.2, 10.0)]
    pose = np.array([0.3, -5.4, 0.02])
    for one in outer:
        one.settle(placed(one.points, pose - [slide, 0, 0]))
    _, slope = pushed(outer, pose)
    for axis, step in enumerate(1e-6 * np.eye(3)):
        high, low = (pushed(outer, pose + sign * step)[0] for sign in (1, -1))
        np.testing.assert_allclose((high - low) / 2e-6, slope[:, axis], atol=1e-4)


def test_sockets_let_the_tongue_in_and_nothing_else():
    inside = sockets((0.0, 20.0), 3.1)
    free = np.array([[0.0, 3.0], [3.05, 3.0], [20.0, 5.9], [10.0, -0.1], [3.2, 0.05]])
    assert (inside(free)[0] <= 0).all()
    met = np.array([[3.2, 3.0], [10.0, 0.2], [20.0, 6.3], [3.2, 0.15]])
    depth, normal = inside(met)
    np.testing.assert_allclose(depth, [0.1, 0.2, 0.3, (0.15 + 0.1 - 0.2) / np.sqrt(2)], atol=1e-9)
    half = np.sqrt(0.5)
    np.testing.assert_allclose(normal, [[-1, 0], [0, -1], [0, -1], [-half, -half]], atol=1e-9)
