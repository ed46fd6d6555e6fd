"""Worn edges: wide tops stay flat in the middle, and thin parts do not become hollow."""

import numpy as np
import pytest
from tactileforge_sim.geometry.heightfields import worn
from tactileforge_sim.geometry.indenter_geometry import DEEP


def bar(width: float, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    return np.where(np.abs(x) <= width / 2, 0.0, DEEP)


@pytest.mark.parametrize("width", [0.2, 0.3, 0.4])
def test_a_thin_part_has_no_hollow(width: float) -> None:
    x = np.linspace(-width / 2, width / 2, 41)
    top = worn(lambda x, y: bar(width, x, y), 0.25)(x, np.zeros_like(x))
    np.testing.assert_allclose(top, 0.25)


def test_a_wide_part_is_worn_near_its_edges_only() -> None:
    x = np.linspace(-2, 2, 401)
    top = worn(lambda x, y: bar(4, x, y), 0.25)(x, np.zeros_like(x))
    inside = np.abs(x) < 1.74
    np.testing.assert_array_equal(top[inside], 0)
    np.testing.assert_allclose(top[np.abs(x) > 1.76], 0.25)
