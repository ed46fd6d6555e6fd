import math

import pytest
import torch
from tactileforge_sim.optics.markers import Markers, coverage, print_markers
from tactileforge_sim.optics.sensor_instances import draw_instance

from tactileforge.errors import ConfigError
from tactileforge.specs.simulated import PUBLISHED

PATTERNS = {name: known.pattern for name, known in PUBLISHED.items() if known.pattern}

SIZE = (60, 80)
SPACING = 0.2


def dark(markers, motion=None):
    """Darkness painted by markers on a white image: (B, H, W)."""
    batch = 1 if motion is None else len(motion)
    pictures = torch.full((batch, 3, *SIZE), 255.0)
    markers.paint(pictures, motion, SPACING)
    return 255 - pictures[:, 0]


def centroid(picture):
    total = picture.sum()
    x = (picture * torch.arange(picture.shape[1])).sum() / total
    y = (picture * torch.arange(picture.shape[0])[:, None]).sum() / total
    return float(x), float(y)


def one(x=0.3, y=-0.7, radius=0.9):
    return Markers(torch.tensor([[x, y]]), torch.tensor([radius]))


def test_disc_covers_its_area_at_any_place():
    for shift in (0.0, 0.21, 0.5):
        cover = coverage(torch.tensor([[[20.0 + shift, 15.0]]]), torch.tensor([4.5]), 30, 40)
        assert float(cover.sum()) == pytest.approx(math.pi * 4.5**2, rel=0.01)
        assert cover.min() == 0
        assert cover.max() == 1


def test_marker_lies_where_it_says():
    x, y = centroid(dark(one())[0])
    assert x == pytest.approx(39.5 + 0.3 / SPACING, abs=0.02)
    assert y == pytest.approx(29.5 - 0.7 / SPACING, abs=0.02)


def test_marker_moves_with_the_surface():
    before = centroid(dark(one())[0])
    after = centroid(dark(one(), torch.tensor([[[0.5, -0.26]]]))[0])
    assert after[0] - before[0] == pytest.approx(0.5 / SPACING, abs=0.05)
    assert after[1] - before[1] == pytest.approx(-0.26 / SPACING, abs=0.05)


def test_motion_of_pixels_is_read_at_the_markers():
    x = (torch.arange(SIZE[1]) - 39.5) * SPACING
    field = torch.stack([0.1 * x, 0 * x], -1).expand(2, *SIZE, 2)
    places = torch.tensor([[-4.0, 2.0], [3.1, -1.0]])
    markers = Markers(places, torch.full((2,), 0.6))
    points = torch.stack([0.1 * places[:, 0], 0 * places[:, 0]], -1).expand(2, -1, -1)
    torch.testing.assert_close(dark(markers, field), dark(markers, points), atol=0.01, rtol=0)


def test_markers_that_leave_the_picture_are_gone():
    assert dark(one(), torch.tensor([[[50.0, 0.0]]])).max() == 0
    half = dark(one(x=8.0, y=0.0))  # its middle lies on the right edge
    assert float(half.sum()) == pytest.approx(float(dark(one()).sum()) / 2, rel=0.05)


def test_grid_of_the_mini_has_its_published_pitch():
    markers = print_markers(PATTERNS["gelsight_mini"], torch.Generator().manual_seed(0))
    rows = markers.places.view(7, 9, 2)
    assert float((rows[:, 1:, 0] - rows[:, :-1, 0]).mean()) == pytest.approx(2.4, abs=0.01)
    assert float((rows[1:, :, 1] - rows[:-1, :, 1]).mean()) == pytest.approx(2.4, abs=0.02)
    assert float(2 * markers.radii.mean()) == pytest.approx(1.0, abs=0.03)
    assert PATTERNS["gelsight"].columns * PATTERNS["gelsight"].rows == 99


@pytest.mark.parametrize("sensor", PATTERNS)
def test_grids_leave_most_of_the_gel_clear(sensor):
    markers = print_markers(PATTERNS[sensor], torch.Generator().manual_seed(1))
    extent = markers.places.amax(0) - markers.places.amin(0)
    share = float((math.pi * markers.radii**2).sum() / extent.prod())
    assert 0.01 < share < 0.3


def test_wrong_motion_is_said():
    with pytest.raises(ConfigError, match=r"give \(B, 1, 2\) at the markers, or \(B, 60, 80, 2\)"):
        dark(one(), torch.zeros(1, 5, 2))


def test_sensor_without_markers():
    with pytest.raises(ConfigError, match="unknown marker gel 'digit'"):
        draw_instance("digit", 0, (32, 24), markers=True)
