"""Columns of forces in another order."""

import numpy as np
import pytest

from tactileforge.checks.force_axes import ForceAxes

RNG = np.random.default_rng(0)


def press(shear: float, count: int = 60) -> np.ndarray:
    """A press of 8 N, sliding to and fro with a share of it."""
    way = np.linspace(0, 1, count)
    normal = 8 * np.sin(np.pi * way)
    force = [shear * normal * np.sin(9 * way), 0.4 * shear * normal * np.cos(7 * way), normal]
    return np.stack(force, axis=1) + RNG.normal(0, 0.02, (count, 3))


def told(*forces: np.ndarray) -> str:
    axes = ForceAxes()
    for force in forces:
        axes.add(force)
    return axes.pressing()


@pytest.mark.parametrize("shear", [0.05, 0.3, 0.8, 1.2])
@pytest.mark.parametrize("sign", [1, -1])
def test_exchanged_axes_are_told(shear: float, sign: int) -> None:
    force = press(shear) * [1, 1, sign]
    assert told(force) == ""
    assert told(force[:, [2, 1, 0]]) == "x"
    assert told(force[:, [0, 2, 1]]) == "y"
    assert told(force[:, [2, 0, 1]]) == "x"


def test_slides_to_one_side_are_no_exchange() -> None:
    """Shear of one sign, up to a coefficient of friction of 1.8."""
    normal = np.linspace(0.1, 6, 50)
    for friction in (0.5, 1.0, 1.8):
        assert told(np.stack([friction * normal, 0 * normal, normal], axis=1)) == ""


def test_stills_are_told_together() -> None:
    stills = [force[None] for force in press(0.4)[10:50:3]]
    assert told(*stills) == ""
    assert told(*(force[:, [2, 1, 0]] for force in stills)) == "x"
    assert told(*stills[:5]) == told(np.zeros((50, 3))) == told(np.full((50, 3), np.nan)) == ""
