import numpy as np
import pytest
from tactileforge_live.record.wrench import axes_matrix, interpolate_samples, rotate_wrenches
from tactileforge_sim.sensors.sim_wrench import SimWrench

from tactileforge.errors import ConfigError


def test_between_samples_it_is_linear():
    times = np.arange(0, 1, 0.01)
    wrenches = np.outer(times, [1.0, -2.0, 3.0, 0.1, 0.0, 5.0])
    wanted = np.array([0.0, 0.1234, 0.5051, 0.99])
    assert interpolate_samples(wanted, times, wrenches) == pytest.approx(
        np.outer(wanted, [1.0, -2.0, 3.0, 0.1, 0.0, 5.0]), rel=1e-5
    )


def test_where_there_is_no_sample_on_both_sides_nothing_is_known():
    times = np.array([1.0, 1.05, 1.4, 1.45])
    found = interpolate_samples(np.array([0.9, 1.02, 1.2, 1.42, 1.5]), times, np.ones((4, 6)))
    assert np.isnan(found).all(1).tolist() == [True, False, True, False, True]
    assert np.isnan(interpolate_samples(np.array([1.0]), times[:1], np.ones((1, 6)))).all()
    assert interpolate_samples(np.array([]), times, np.ones((4, 6))).shape == (0, 6)


def test_axes_turn_forces_and_torques_alike():
    wrench = np.array([[1, 2, 3, 4, 5, 6]], np.float32)
    assert rotate_wrenches(wrench, axes_matrix(["x", "-y", "-z"])).tolist() == [
        [1, -2, -3, 4, -5, -6]
    ]
    assert rotate_wrenches(wrench, axes_matrix(["+z", "x", "y"])).tolist() == [[3, 1, 2, 6, 4, 5]]
    assert np.linalg.det(axes_matrix(["-y", "x", "z"])) == pytest.approx(1)


@pytest.mark.parametrize(
    ("axes", "message"),
    [
        (["x", "y", "-z"], "mirror image"),
        (["x", "y", "y"], "each of x, y and z once"),
        ("xyw", "once"),
    ],
)
def test_axes_that_are_none(axes, message):
    with pytest.raises(ConfigError, match=message):
        axes_matrix(axes)


def test_a_simulated_wrench_rests_while_it_is_tared():
    wrench = SimWrench(newton=4.0, period=2.0, bias=0.5, rest=3.0)
    for seconds in (0.0, 1.0, 3.0):
        assert wrench.sample(seconds)[:3] == pytest.approx(0.5)
    assert wrench.sample(4.0)[2] == pytest.approx(4.5)  # half a period later
    assert min(wrench.sample(3 + i / 10)[2] for i in range(40)) >= 0.5  # it never pulls
