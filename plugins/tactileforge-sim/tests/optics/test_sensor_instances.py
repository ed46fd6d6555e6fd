import pytest
import torch
from tactileforge_sim.optics.sensor_instances import draw_instance

from tactileforge.errors import ConfigError
from tactileforge.specs.published import SIMULATED, SPECS

SIZE = (60, 80)


@pytest.mark.parametrize("sensor", SIMULATED)
def test_seed_draws_the_unit(sensor):
    first, again, other = (draw_instance(sensor, seed, SIZE) for seed in (7, 7, 8))
    assert torch.equal(first.background, again.background)
    assert torch.equal(first.calibration.fine, again.calibration.fine)
    assert first.noise == again.noise
    assert (first.background - other.background).abs().mean() > 1
    assert not torch.equal(first.calibration.fine, other.calibration.fine)


@pytest.mark.parametrize("sensor", SIMULATED)
def test_units_have_the_size_and_scale_of_their_sensor(sensor):
    unit, spec = draw_instance(sensor, 0, randomise="none"), SPECS[sensor]
    assert unit.background.shape == (3, spec.height, spec.width)
    if spec.area_mm:
        assert unit.spacing * spec.height == pytest.approx(spec.area_mm[0])
    assert draw_instance(sensor, 0, (60, 80), randomise="none").spacing * 60 == pytest.approx(
        unit.spacing * spec.height
    )


@pytest.mark.parametrize("sensor", SIMULATED)
def test_backgrounds_are_lit_and_smooth(sensor):
    for seed in range(6):
        ground = draw_instance(sensor, seed, (120, 160)).background
        assert 20 < float(ground.mean()) < 235
        clipped = (ground <= 4) | (ground >= 251)
        assert float(clipped.float().mean()) < 0.2
        step = (ground[..., 1:] - ground[..., :-1]).abs()
        assert float(step.median()) < 3


def test_light_that_is_strong_in_the_background_is_strong_on_slopes():
    units = [draw_instance("digit", seed, SIZE) for seed in range(40)]
    slopes = torch.stack([unit.calibration.fine[:2].abs().sum((0, 1)) for unit in units])
    assert (slopes.std(0) / slopes.mean(0)).min() > 0.05
    gelsights = [draw_instance("gelsight", seed, SIZE).calibration.lights for seed in range(20)]
    assert len(set(gelsights)) == 2  # units are of one of two calibrations


def test_markers_on_request():
    assert draw_instance("gelsight_mini", 0, SIZE).markers is None
    marked = draw_instance("gelsight_mini", 0, SIZE, markers=True, randomise="none").markers
    assert marked is not None
    assert len(marked.places) == 63
    assert draw_instance("duragel", 0, SIZE).markers is not None
    assert draw_instance("duragel", 0, SIZE, markers=False).markers is None
    with pytest.raises(ConfigError, match="Draw the unit with markers=False"):
        draw_instance("digit", 0, SIZE, markers=True)


def test_unknown_sensor():
    with pytest.raises(ConfigError, match="unknown simulated sensor 'digt'; did you mean 'digit'"):
        draw_instance("digt", 0)
