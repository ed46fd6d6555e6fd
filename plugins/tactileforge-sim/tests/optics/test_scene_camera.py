import numpy as np
import pytest
from tactileforge_sim.geometry.shapes import INDENTERS, shape
from tactileforge_sim.optics.scene_camera import render_scene_image

from tactileforge.errors import ConfigError


def test_a_view_is_a_picture_that_its_seed_decides():
    picture = render_scene_image(shape("pentagram"), 112, 5)
    assert picture.shape == (112, 112, 3)
    assert picture.dtype == np.uint8
    np.testing.assert_array_equal(picture, render_scene_image(shape("pentagram"), 112, 5))
    assert np.abs(picture.astype(int) - render_scene_image(shape("pentagram"), 112, 6)).mean() > 5


def test_the_colour_belongs_to_the_name():
    # The middle of a plain tip, over many tables and lights.
    for name, strongest in (("square_prism", 1), ("wavy_cylindrical", 0)):
        tips = np.stack(
            [render_scene_image(shape(name), 64, seed)[28:36, 28:36] for seed in range(8)]
        )
        assert tips.reshape(-1, 3).mean(0).argmax() == strongest


def test_views_tell_shapes_apart():
    # By colours alone, the nearest of other views is that of the same shape far above chance.
    names = list(INDENTERS)[:24]
    known = np.stack([[_hue(render_scene_image(shape(n), 48, s)) for s in range(3)] for n in names])
    asked = np.stack([_hue(render_scene_image(shape(n), 48, 99)) for n in names])
    away = np.abs(known[None] - asked[:, None, None]).sum((-1, -2)).min(-1)
    assert (away.argmin(1) == np.arange(24)).mean() > 0.4  # chance is 0.04


def _hue(picture):
    """The colours of a picture, whatever its pose: a histogram of hue and strength."""
    rgb = picture.reshape(-1, 3).astype(float) / 255
    strength = np.ptp(rgb, axis=1)
    share = rgb / rgb.sum(1, keepdims=True).clip(0.1)
    hist, *_ = np.histogram2d(
        share[:, 0], share[:, 1], bins=24, range=((0, 1), (0, 1)), weights=strength
    )
    return hist / hist.sum()


def test_a_hole_shows_the_table_through_it():
    # The middle of a plate is of one tone; that of the ring is the table's.
    def spread(name):
        views = np.stack(
            [render_scene_image(shape(name), 64, seed)[29:35, 29:35] for seed in range(12)]
        )
        return views.reshape(12, -1, 3).mean(1).std(0).mean()

    assert spread("large_ring") > 2 * spread("square_prism")


def test_the_shape_is_seen_and_not_its_frame():
    # Same seed, two shapes: only where one of them stands, or its shadow, do pictures differ.
    small, other = (
        render_scene_image(shape(name), 96, 3).astype(int)
        for name in ("small_ring", "small_sphere")
    )
    differ = (np.abs(small - other).max(-1) > 0).mean()
    assert 0.02 < differ < 0.35


def test_a_view_that_is_too_small_is_refused():
    with pytest.raises(ConfigError, match="8 x 8 pixels; the limit is 16"):
        render_scene_image(shape("ring_shaped"), 8, 0)
