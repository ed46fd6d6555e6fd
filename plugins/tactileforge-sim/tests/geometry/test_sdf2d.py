import cv2
import numpy as np
import pytest
from tactileforge_sim.geometry import sdf2d as m

PI = np.pi


def _area(mask):
    cell = 0.02
    axis = np.arange(-8, 8, cell) + cell / 2
    return (mask(*np.meshgrid(axis, axis)) < 0).sum() * cell**2


def _crescent(radius, bite, shift):
    """A disc without its lens with another one: two circular segments."""
    a = (shift**2 + radius**2 - bite**2) / (2 * shift)
    b = shift - a
    lens = radius**2 * np.arccos(a / radius) - a * np.sqrt(radius**2 - a**2)
    lens += bite**2 * np.arccos(b / bite) - b * np.sqrt(bite**2 - b**2)
    return PI * radius**2 - lens


@pytest.mark.slow
@pytest.mark.parametrize(
    ("mask", "area"),
    [
        (m.circle(3), PI * 9),
        (m.ellipse(5, 2), PI * 10),
        (m.box(5, 3), 15),
        (m.regular(3, 4), 3 * np.sqrt(3) / 4 * 16),
        (m.regular(6, 4), 3 * np.sqrt(3) / 2 * 16),
        (m.regular(8, 4), 2 * np.sqrt(2) * 16),
        (m.star(5, 6, 2.3), 5 * 6 * 2.3 * np.sin(PI / 5)),
        (m.sector(5, 90), PI * 25 / 4),
        (m.sector(5, 300), PI * 25 * 5 / 6),
        (m.stroke(1, (-2, 0), (2, 0)), 4 + PI / 4),
        (m.arc(1, 3, 90, 360), 3 * 1.5 * PI + PI / 4),
        (m.wavy(4.8, 0.6, 8), PI * (4.8**2 + 0.6**2 / 2)),
        (m.ring(5, 3), PI * 16),
        (m.trapezoid(5, 10, 6), 45),
        (m.tee(9, 2.6), 9 * 2.6 + 6.4 * 2.6),
        (m.cross(10, 3), 2 * 30 - 9),
        (m.crescent(5, 4.2, 2.4), _crescent(5, 4.2, 2.4)),
        (m.teardrop(3, 6), 3 * np.sqrt(27) + 9 * (PI - np.arccos(0.5))),
        (m.heart(10), 36 + PI * 9),
        (m.minus(m.box(8, 8), m.circle(3)), 64 - PI * 9),
        (m.both(m.box(8, 8), m.circle(4.5), m.box(2, 20)), 16),
        (m.grid(3, 2, (3, 4), m.tee(2, 0.5)), 6 * 1.75),
        (m.around(5, 4, m.ellipse(0.5, 1)), 5 * PI / 2),
        (m.grow(m.box(4, 2), 1), 8 + 2 * (4 + 2) + PI),
        (m.at(2, 1, m.turn(37, m.box(3, 2))), 6),
    ],
)
def test_areas_are_those_of_the_closed_forms(mask, area):
    assert _area(mask) == pytest.approx(area, rel=4e-3)


def test_distances_to_a_polygon_agree_with_opencv():
    corners = [(-4, -3), (1, -3), (4.5, 3), (0, 1), (-4.5, 3)]
    points = np.random.default_rng(0).uniform(-7, 7, (200, 2))
    contour = np.asarray(corners, dtype=np.float32)
    expected = [-cv2.pointPolygonTest(contour, tuple(map(float, p)), True) for p in points]
    distances = m.polygon(*corners)(points[:, 0], points[:, 1])
    np.testing.assert_allclose(distances, expected, atol=1e-5)


@pytest.mark.parametrize(
    "mask",
    [
        m.box(5, 3),
        m.ellipse(5, 2),
        m.ellipse(1, 4),
        m.sector(5, 90),
        m.sector(5, 300),
        m.arc(1, 3, 20, 250),
        m.regular(5, 4),
    ],
)
def test_the_distance_is_that_to_the_nearest_point_of_the_edge(mask):
    axis = np.arange(-7, 7, 0.02)
    x, y = np.meshgrid(axis, axis)
    edge = np.abs(mask(x, y)) < 0.015
    points = np.random.default_rng(1).uniform(-3, 3, (40, 2))
    nearest = [np.hypot(x[edge] - px, y[edge] - py).min() for px, py in points]
    np.testing.assert_allclose(np.abs(mask(points[:, 0], points[:, 1])), nearest, atol=0.03)


def test_a_positive_turn_is_clockwise_in_the_picture():
    upright = m.at(0, -3, m.circle(1))  # above the middle: y points down
    turned = m.turn(90, upright)
    assert turned(np.array([3.0]), np.array([0.0])) == pytest.approx(-1)


def test_copies_around_a_circle_point_outwards():
    arrow = m.around(4, 4, m.polygon((0, -1), (0.3, 0), (-0.3, 0)))
    tips = arrow(np.array([0, 4.9, 0, -4.9]), np.array([-4.9, 0, 4.9, 0]))
    tails = arrow(np.array([0, 3.9, 0, -3.9]), np.array([-3.9, 0, 3.9, 0]))
    assert (tips < 0).all()
    assert (tails > 0).all()
