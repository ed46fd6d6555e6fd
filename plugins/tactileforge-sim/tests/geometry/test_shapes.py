from itertools import combinations

import cv2
import numpy as np
import pytest
from tactileforge_sim.geometry.indenter_geometry import (
    DEEP,
    STEEP,
    Shape,
    ball,
    extrude,
    join,
    lift,
    printed,
    shape_of,
)
from tactileforge_sim.geometry.sdf2d import box, circle
from tactileforge_sim.geometry.shapes import BENCH_TEST, BENCH_TRAIN, INDENTERS, shape

from tactileforge.errors import ConfigError

SPACING = 0.1
PIXELS = 201
MAPS = {name: indenter.map(PIXELS, SPACING) for name, indenter in INDENTERS.items()}

#: Mirrored left to right, the shape is the same.
MIRRORED = (
    1,
    2,
    4,
    5,
    8,
    9,
    10,
    15,
    16,
    18,
    24,
    30,
    33,
    36,
    37,
    42,
    46,
    50,
    52,
    58,
    61,
    66,
    67,
    71,
)
ROUND = (7, 12, 19, 28, 29, 39)
#: Holes that the flat tip has.
HOLES = {
    23: 4, 24: 1, 25: 1, 26: 1, 27: 6, 30: 4, 41: 2, 42: 4, 43: 6, 44: 8, 45: 19, 46: 3, 47: 6,
    48: 9, 49: 5, 50: 1, 51: 20, 52: 1, 53: 1, 54: 1, 55: 6, 56: 64, 57: 2, 66: 9, 67: 9, 68: 25,
    69: 1,
}  # fmt: skip
#: Separate parts that touch; 31 is a frame around 9 squares.
TIPS = {21: 5, 22: 16, 31: 10, 32: 9, 33: 9, 34: 12, 37: 9, 38: 3, 40: 8, 64: 16}


def _map(index):
    return MAPS[next(name for name, known in INDENTERS.items() if known.index == index)]


def _components(mask, connectivity=4):
    return cv2.connectedComponents(mask.astype(np.uint8), connectivity=connectivity)[0] - 1


def test_the_indenters_are_those_of_the_table():
    assert [known.index for known in INDENTERS.values()] == list(range(1, 72))
    assert all(name == known.name for name, known in INDENTERS.items())
    assert shape("clover_shaped").index == 71
    assert {shape("elliptical_13").words, shape("elliptical_62").words} == {"elliptical"}


def test_the_split_is_that_of_the_paper():
    by_split = {
        split: tuple(known.index for known in INDENTERS.values() if known.split == split)
        for split in ("bench_train", "bench_test", "pretrain")
    }
    assert by_split["bench_train"] == BENCH_TRAIN == (62, 65, 66, 67, 68, 70, 71)
    assert by_split["bench_test"] == BENCH_TEST == (63, 64, 69)
    assert len(by_split["pretrain"]) == 61
    names = [shape_.words for shape_ in INDENTERS.values() if shape_.split == "bench_test"]
    assert names == ["right angled trapezoidal", "small square array", "large triangular hole"]


@pytest.mark.parametrize("name", INDENTERS)
def test_heights_start_at_zero_and_end_within_the_radius(name):
    high, radius = MAPS[name], INDENTERS[name].radius
    assert high.dtype == np.float32
    assert high.shape == (PIXELS, PIXELS)
    assert 0 <= high.min() < 0.03
    assert high.max() == DEEP
    axis = (np.arange(PIXELS) - PIXELS // 2) * SPACING
    away = np.hypot(*np.meshgrid(axis, axis))
    assert (high[away > radius + 0.1] == DEEP).all()
    assert (high[(away > radius - 0.3) & (away <= radius)] < DEEP).any()


@pytest.mark.parametrize("name", INDENTERS)
def test_tips_are_4_to_14_mm_wide(name):
    # Where a gel would touch that is pressed by a little over 1 mm: balls are
    # wide only there, and the raised tips stand 1 mm out of their plate.
    rows, columns = np.nonzero(MAPS[name] < 1.1)
    size = max(np.ptp(rows), np.ptp(columns)) * SPACING
    assert 3.5 <= size <= 14.4


def test_all_indenters_differ():
    small = {name: high[::2, ::2] for name, high in MAPS.items()}
    closest = min(
        (float(np.abs(small[a] - small[b]).mean()), a, b) for a, b in combinations(small, 2)
    )
    assert closest[0] > 0.05, closest  # mm, over 20 x 20 mm that are mostly empty


def test_walls_are_steep_and_no_steeper():
    for high in MAPS.values():
        steps = np.abs(np.diff(high, axis=1)).max() / SPACING
        assert 0.7 * STEEP < steps < 1.2 * STEEP  # the distance to waves is of first order


@pytest.mark.parametrize("index", MIRRORED)
def test_mirrored_shapes(index):
    high = _map(index)
    np.testing.assert_allclose(high, high[:, ::-1], atol=1e-4)


@pytest.mark.parametrize("index", [26, 35, 47, 57, 59, 63])
def test_shapes_that_a_mirror_changes(index):
    high = _map(index)
    assert np.abs(high - high[:, ::-1]).max() > 1


def test_only_round_shapes_are_marked_round():
    assert tuple(known.index for known in INDENTERS.values() if known.round) == ROUND


@pytest.mark.parametrize(("index", "quarters"), [(11, 1), (17, 1), (64, 1), (68, 1), (70, 1)])
def test_a_quarter_turn_changes_nothing(index, quarters):
    high = _map(index)
    np.testing.assert_allclose(np.rot90(high, quarters), high, atol=1e-4)


@pytest.mark.parametrize(("index", "count"), HOLES.items())
def test_hole_shapes_have_holes(index, count):
    fine = next(known for known in INDENTERS.values() if known.index == index).map(401, 0.04)
    open_ = fine > 0.4
    assert _components(open_, 8) == count + 1  # and what lies around the tip
    assert _components(~open_) == 1


@pytest.mark.parametrize(("index", "count"), TIPS.items())
def test_arrays_have_separate_tips(index, count):
    high = _map(index)
    touching = high < 0.15
    assert _components(touching) == count


@pytest.mark.slow
def test_the_contact_area_converges_with_resolution():
    for name in (
        "pentagram",
        "ring_shaped",
        "dense_small_holes",
        "small_sphere_array",
        "heart_shaped",
    ):
        areas = [
            float((INDENTERS[name].map(round(16 / step), step) < 0.3).sum()) * step**2
            for step in (0.1, 0.05, 0.0125)
        ]
        assert areas[0] == pytest.approx(areas[2], rel=0.04)
        assert areas[1] == pytest.approx(areas[2], rel=0.02)


def test_a_ball_is_a_sphere():
    x = np.linspace(-1.9, 1.9, 21)
    heights = ball(2.0)(x, np.zeros_like(x))
    np.testing.assert_allclose(heights, 2 - np.sqrt(4 - x**2), atol=1e-12)
    small = shape("small_sphere").height(np.array([1.0]), np.array([0.0]))
    assert small == pytest.approx(2.2 - np.sqrt(2.2**2 - 1))


def test_the_edge_is_a_quarter_round_of_the_fillet():
    height = extrude(circle(4), fillet=0.3)
    x = np.array([0.0, 3.7, 3.85, 3.9])
    expected = 0.3 - np.sqrt(0.09 - np.array([0, 0, 0.15, 0.2]) ** 2)
    np.testing.assert_allclose(height(x, np.zeros(4)), expected, atol=1e-12)


def test_a_raised_shape_stands_on_its_plate():
    height = join(extrude(circle(2)), lift(extrude(circle(5)), 1.0))
    heights = height(np.array([0.0, 3.5, 8.0]), np.zeros(3))
    np.testing.assert_allclose(heights, [0, 1, DEEP])


def test_printed_lines_have_their_period_and_depth():
    flat = shape_of("plate", extrude(box(10, 10)))
    lines = printed(flat, period=0.2, amplitude=0.02, angle=0)
    y = np.arange(0, 2, 0.01)
    high = lines.height(np.zeros_like(y), y)
    assert high.min() == pytest.approx(0, abs=1e-12)
    assert high.max() == pytest.approx(0.02)
    np.testing.assert_allclose(high[20:], high[:-20], atol=1e-12)
    assert lines.height(np.array([20.0]), np.array([0.0])) == DEEP


@pytest.mark.parametrize(("period", "amplitude"), [(0, 0.01), (0.15, -0.01), (0.1, 0.2)])
def test_printed_lines_that_no_print_has_are_refused(period, amplitude):
    with pytest.raises(ConfigError, match="the period must be above 0 mm"):
        printed(shape("cylindrical"), period, amplitude)


def test_a_grid_that_is_too_coarse_is_refused():
    with pytest.raises(ConfigError, match=r"'small_ring' is 6.6 mm wide.* at most 1.65 mm"):
        shape("small_ring").map(8, 2.0)
    detailed = Shape("fine", extrude(box(5, 5)), radius=4.0, detail=0.2)
    with pytest.raises(ConfigError, match=r"details of 0.2 mm.* at most 0.2 mm"):
        detailed.map(50, 0.25)
    with pytest.raises(ConfigError, match="a spacing above 0"):
        detailed.map(50, 0.0)


def test_a_typo_gets_the_nearest_name():
    with pytest.raises(ConfigError, match="did you mean 'clover_shaped'"):
        shape("clover_shape")
    with pytest.raises(ConfigError, match="did you mean 'cloth_plain'"):
        shape("cloth_plane")
