"""Two gels and an object: equilibrium, and Coulomb's law for the grip as a whole."""

import numpy as np
import pytest
from tactileforge_depth.gel import Gel
from tactileforge_policies.envs.chip import FACE
from tactileforge_policies.envs.fingers import mirrored
from tactileforge_policies.envs.grip import TOLERANCE, Body, Grip
from tactileforge_policies.envs.outer import Solid, ground

MU = 0.8
AWAY = np.zeros(2)


def gripped(weight, depth=0.25, centre=(0.0, 0.0)):
    """A chip, squeezed without weight, then left to the grip."""
    grip = Grip(Body(FACE, 1.0, weight, MU, centre=centre), Gel(friction=MU), rate=6.0)
    grip.place(np.zeros(3), 2 * (1.0 - depth))
    return grip, 2 * (1.0 - depth)


def test_nothing_is_felt_before_the_gels_touch():
    grip, _ = gripped(0.0, depth=-0.01)
    assert grip.held.normal == 0
    assert not grip.held.gels.any()


def test_gels_bear_the_weight_and_its_torque():
    grip, opening = gripped(0.5, centre=(2.0, 0.0))
    held = grip.close(opening, AWAY, [])
    assert held.balanced
    assert held.gels[1] == pytest.approx(-0.5, abs=TOLERANCE)
    assert held.gels[2] == pytest.approx(-2.0 * 0.5, abs=4 * TOLERANCE + 0.02)
    assert held.pose[1] > 0, "it sags"
    assert held.pose[2] > 0, "it turns towards its centre of gravity"


@pytest.mark.parametrize(("share", "holds"), [(0.9, True), (1.1, False)])
def test_a_grip_holds_twice_friction_times_its_force_and_no_more(share, holds):
    normal = gripped(0.0)[0].held.normal
    grip, opening = gripped(share * 2 * MU * normal)
    held = grip.close(opening, AWAY, [])
    assert held.balanced is holds
    # A pull along the gel tilts its surface, and so changes the normal force by a few percent.
    assert abs(held.gels[1]) <= 2 * MU * held.normal + TOLERANCE
    assert held.normal == pytest.approx(normal, rel=0.1)


def test_forces_balance_where_the_object_meets_the_floor():
    grip, opening = gripped(0.1, depth=0.3)
    floor = Solid(np.array([[-2.0, 6.0], [2.0, 6.0]]), ground(lambda x: 0 * x), 3.0, 0.5)
    tool = np.array([0.0, -6.1])
    for _ in range(4):
        tool = tool + np.array([0.2, 0.1])
        held = grip.close(opening, tool, [floor])
        assert held.balanced
        np.testing.assert_allclose((held.gels + held.outer) / [1, 1, 4], 0, atol=TOLERANCE)
    load = floor.load(np.array([[-2.0, 6.0], [2.0, 6.0]]) + held.pose[:2] + tool)
    assert held.gels[1] == pytest.approx(load - 0.1, abs=0.05), "the floor pushes it up"
    assert held.gels[0] > 0, "and drags it back"


def test_the_right_finger_feels_the_mirror_image():
    grip, opening = gripped(0.5, centre=(2.0, 0.0))
    left = grip.close(opening, np.array([0.0, 0.0]), []).moment
    right = mirrored(left)
    assert (right.force[0] - left.force[0] * left.force.new_tensor([-1, 1, 1])).abs().max() == 0
    # Torque and force are those of the mirrored fields.
    area = 0.4**2
    pull = right.shear[0].sum((1, 2)) * area
    assert pull[1] == pytest.approx(float(right.force[0, 1]), abs=1e-3)
    n = right.shear.shape[-1]
    line = (np.arange(n) - (n - 1) / 2) * 0.4
    shear = right.shear[0].numpy()
    twist = (line[None] * shear[1] - line[:, None] * shear[0]).sum() * area
    assert twist == pytest.approx(float(right.torque[0]), abs=1e-3)
