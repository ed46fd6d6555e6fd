"""Pictures of known surfaces are read back: the calibration inverted, slopes integrated."""

import math

import pytest
import torch
from tactileforge_depth.inverse import Poisson, SurfaceReader
from tactileforge_depth.lighting import lamp_calibration, load_optics
from tactileforge_sim.optics.render import Optics
from tactileforge_sim.optics.sensor_instances import SensorInstance

from tactileforge.contracts import Lamp
from tactileforge.errors import ConfigError

SIZE, SPACING = (60, 80), 0.2
STILL = torch.full((3, *SIZE), 120.0)


def bumps():
    """A round bump, and an oblique ridge: depth, mm, float32 (2, H, W)."""
    y = (torch.arange(SIZE[0])[:, None] - 30) * SPACING
    x = (torch.arange(SIZE[1]) - 42) * SPACING
    ball = 0.5 * torch.exp(-(x * x + y * y) / (2 * 1.2**2))
    along, across = 0.8 * x + 0.6 * y, 0.8 * y - 0.6 * x
    ridge = 0.4 * torch.exp(-(along**2) / (2 * 2.5**2) - across**2 / (2 * 0.8**2))
    return torch.stack([ball, ridge])


def correlation(one, other):
    return float(torch.corrcoef(torch.stack([one.flatten(), other.flatten()]))[0, 1])


def test_poisson_integrates_the_slopes_of_a_polynomial_exactly():
    """Between neighbours a quadratic rises by the mean of their slopes."""
    y, x = torch.meshgrid(torch.arange(12.0) * SPACING, torch.arange(17.0) * SPACING, indexing="ij")
    surface = 0.3 * x * x - 0.2 * x * y + 0.1 * y * y + 0.5 * x
    slope = torch.stack([0.6 * x - 0.2 * y + 0.5, -0.2 * x + 0.2 * y])
    found = Poisson((12, 17), SPACING)(slope[None])[0]
    torch.testing.assert_close(found, surface - surface.mean(), rtol=0, atol=1e-4)


@pytest.mark.parametrize("name", ["gelsight", "gelsight_fots", "digit"])
def test_surfaces_are_read_back_from_simulated_pictures(name):
    """With the noise of the camera, and scattered and blocked light."""
    calibration = load_optics(name)
    unit = SensorInstance("", 1, STILL, calibration, SPACING, calibration.noise)
    true = bumps()
    pictures = Optics(unit).render(true, first=0)
    found = SurfaceReader(calibration, SIZE, SPACING).read(pictures, STILL)
    for depth, surface in zip(found.depth, true, strict=True):
        assert correlation(depth, surface) > 0.97
        assert float((depth - surface).square().mean().sqrt()) < 0.1 * float(surface.max())
        assert float(depth.max()) == pytest.approx(float(surface.max()), rel=0.25)
    assert torch.allclose(found.normal.norm(dim=1), torch.ones(2, *SIZE), atol=1e-5)


def test_a_matt_surface_under_lamps_gives_its_normals():
    """Without scattered light and shadows the slopes are those of the surface."""
    lamps = [
        Lamp(math.radians(a), math.radians(30), colour, fall=0.0, shadow=0.0)
        for a, colour in ((0, (200, 20, 20)), (120, (20, 200, 20)), (240, (20, 20, 200)))
    ]
    calibration = lamp_calibration(lamps, (20, 20, 20), noise=0.0)
    unit = SensorInstance("", 0, STILL, calibration, SPACING, 0.0)
    true = bumps()[:1]
    found = SurfaceReader(calibration, SIZE, SPACING).read(Optics(unit).render(true), STILL)
    down, right = torch.gradient(true[0], spacing=SPACING)
    wanted = torch.stack([right, down])
    assert float((found.slope[0] - wanted).abs().max()) < 0.05
    assert correlation(found.depth, true) > 0.999


def test_a_picture_without_contact_is_flat():
    found = SurfaceReader(load_optics("digit"), SIZE, SPACING).read(STILL[None], STILL)
    assert float(found.depth.abs().max()) == 0
    assert torch.equal(found.normal[0, 2], torch.ones(SIZE))
    with pytest.raises(ConfigError, match="pictures are"):
        SurfaceReader(load_optics("digit"), (30, 40), SPACING).read(STILL[None], STILL)
