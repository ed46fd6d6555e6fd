from itertools import combinations

import cv2
import numpy as np
import pytest
from tactileforge_sim.geometry.heightfields import bumps, grit, leather, waves, weave
from tactileforge_sim.geometry.indenter_geometry import DEEP
from tactileforge_sim.geometry.shapes import INDENTERS, shape
from tactileforge_sim.geometry.textures import GLYPHS, TEXTURES

from tactileforge.errors import ConfigError

ZERO = np.zeros(1)


def _along(name, start, stop, count=400):
    x = np.linspace(start, stop, count)
    return shape(name).height(x, np.zeros_like(x))


def _parts(mask):
    return cv2.connectedComponents(mask.astype(np.uint8), connectivity=8)[0] - 1


def test_there_are_a_few_dozen_and_none_is_an_indenter():
    assert len(TEXTURES) >= 24
    assert not set(TEXTURES) & set(INDENTERS)
    assert all(known.index is None and known.name == name for name, known in TEXTURES.items())


@pytest.mark.parametrize("name", TEXTURES)
def test_heights_start_at_zero_and_end_within_the_radius(name):
    known = TEXTURES[name]
    axis = np.linspace(-12, 12, 241)
    x, y = np.meshgrid(axis, axis)
    high = known.height(x, y)
    assert 0 <= high.min() < 0.03
    assert high.max() == DEEP
    assert np.isfinite(high).all()
    assert (high[np.hypot(x, y) > known.radius + 0.1] == DEEP).all()


def test_all_textures_differ():
    axis = np.linspace(-8, 8, 80)
    maps = {name: known.height(*np.meshgrid(axis, axis)) for name, known in TEXTURES.items()}
    closest = min((np.abs(maps[a] - maps[b]).mean(), a, b) for a, b in combinations(maps, 2))
    assert closest[0] > 0.015, closest


@pytest.mark.parametrize(
    ("name", "pitch"), [("screw_m3", 0.5), ("screw_m6", 1), ("screw_m10", 1.5)]
)
def test_screw_threads_are_those_of_iso(name, pitch):
    x = np.linspace(-3, 3, 2001)
    crest = shape(name).height(x, np.zeros_like(x))
    shifted = shape(name).height(x + pitch, np.zeros_like(x))
    np.testing.assert_allclose(crest, shifted, atol=1e-9)
    assert np.ptp(crest) == pytest.approx(0.6134 * pitch, rel=2e-3)  # ISO 68-1: 17/24 H
    flank = np.abs(np.diff(crest)).max() / (x[1] - x[0])
    assert np.degrees(2 * np.arctan(1 / flank)) == pytest.approx(60, abs=0.5)


def test_half_a_turn_of_a_thread_is_half_a_pitch():
    # The two sides of the rod, a quarter turn from the top each, are half a turn apart.
    x = np.linspace(-3, 3, 1201)
    near_edge = np.full_like(x, 2.99)
    left, other = (shape("screw_m6").height(x + s * 0.25, s * near_edge) for s in (-1, 1))
    assert np.corrcoef(left, other)[0, 1] > 0.9


def test_plain_cloth_changes_sides_at_each_crossing():
    cloth = weave(0.6, 0.1, lambda i, j: (i + j) % 2)
    x, y = np.random.default_rng(0).uniform(-3, 3, (2, 300))
    np.testing.assert_allclose(cloth(x + 0.6, y + 0.6), cloth(x, y), atol=1e-9)
    np.testing.assert_allclose(cloth(x + 1.2, y), cloth(x, y), atol=1e-9)
    assert np.abs(cloth(x + 0.6, y) - cloth(x, y)).max() > 0.01
    # One yarn further, the other set is on top: the same cloth, turned about its diagonal.
    np.testing.assert_allclose(cloth(x + 0.6, y), cloth(y, x), atol=1e-9)


def test_twill_moves_on_by_one_yarn_from_row_to_row():
    known = weave(0.5, 0.1, lambda i, j: (i + j) % 4 < 2)
    x, y = np.random.default_rng(0).uniform(-3, 3, (2, 300))
    np.testing.assert_allclose(known(x + 0.5, y - 0.5), known(x, y), atol=1e-9)
    assert np.abs(known(x + 0.5, y + 0.5) - known(x, y)).max() > 0.02


def test_ridges_have_their_period_and_direction():
    ridges = waves(2.0, 0.4, angle=90)
    y = np.array([0.0, 1.0, 2.0])
    np.testing.assert_allclose(ridges(np.ones(3), y), [0, 0.4, 0], atol=1e-12)
    np.testing.assert_allclose(ridges(y, np.zeros(3)), 0)


@pytest.mark.parametrize(
    "relief", [leather(1.6, 0.25, 5), bumps(1.8, 0.25, 11), grit(0.5, 0.25, 1)]
)
def test_random_surfaces_stay_within_their_depth_and_know_no_pixels(relief):
    axis = np.linspace(-6, 6, 121)
    coarse = relief(*np.meshgrid(axis, axis))
    fine_axis = np.linspace(-6, 6, 241)
    fine = relief(*np.meshgrid(fine_axis, fine_axis))
    np.testing.assert_allclose(fine[::2, ::2], coarse, atol=1e-12)
    assert coarse.min() >= 0
    assert coarse.max() <= 0.25
    assert coarse.std() > 0.03


def test_another_seed_gives_another_leather():
    axis = np.linspace(-6, 6, 60)
    first, other = (leather(1.6, 0.25, seed)(*np.meshgrid(axis, axis)) for seed in (1, 2))
    assert np.abs(first - other).mean() > 0.02


@pytest.mark.parametrize(
    ("name", "level", "count"),
    [("braille", 0.35, 7), ("pin_header", 0.1, 8), ("studs", 0.5, 4), ("chain", 0.7, 1)],
)
def test_parts_that_stand_out(name, level, count):
    assert _parts(shape(name).map(320, 0.07) < level) == count


def test_a_gear_has_14_teeth():
    angle = np.linspace(0, 2 * np.pi, 2000, endpoint=False)
    rim = shape("gear").height(5.8 * np.cos(angle), 5.8 * np.sin(angle)) < 0.5
    assert (rim & ~np.roll(rim, 1)).sum() == 14


@pytest.mark.parametrize("name", ["letter_a", "letter_h", "letter_m", "numeral_8"])
def test_letters_that_a_mirror_keeps(name):
    high = shape(name).map(160, 0.1)
    np.testing.assert_allclose(high, high[:, ::-1], atol=1e-4)


def test_a_letter_is_upright_and_not_mirrored():
    high = shape("letter_f").map(160, 0.1)
    raised = high < 0.4
    assert raised[:80].sum() > 1.5 * raised[80:].sum()  # the bars are in the upper half
    assert raised[:70, 80:].sum() > 2 * raised[90:, 80:].sum()  # and to the right of the stem


def test_every_glyph_is_raised():
    for name in GLYPHS:
        share = (shape(name).map(160, 0.1) < 0.1).sum() * 0.01
        assert 8 < share < 45, name  # mm^2: strokes about 1 mm wide and 10 to 40 mm long


def test_a_grid_coarser_than_the_yarn_is_refused():
    with pytest.raises(ConfigError, match=r"'cloth_plain'.*details of 0.3 mm.*at most 0.3 mm"):
        shape("cloth_plain").map(40, 0.4)
