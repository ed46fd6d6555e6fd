import math
from dataclasses import replace

import pytest
import torch
import torch.nn.functional as F
from tactileforge_depth import lighting
from tactileforge_depth.features import BLURS, POWERS, exponents, normals, places
from tactileforge_depth.lighting import lamp_calibration
from tactileforge_sim.optics.render import Optics
from tactileforge_sim.optics.sensor_instances import SensorInstance, draw_instance

from tactileforge.contracts import Lamp
from tactileforge.errors import ConfigError
from tactileforge.specs.published import SIMULATED

SIZE = (60, 80)


def bump(x=0.0, y=0.0, size=SIZE, spacing=0.2, depth=0.8, width=1.2):
    """A smooth dent, (1, H, W), at a place in mm from the centre."""
    rows = (torch.arange(size[0]) - (size[0] - 1) / 2) * spacing - y
    columns = (torch.arange(size[1]) - (size[1] - 1) / 2) * spacing - x
    return (depth * torch.exp(-(rows[:, None] ** 2 + columns**2) / width**2))[None]


def plain(calibration, size=SIZE, grey=120.0, spacing=0.2):
    return SensorInstance("", 1, torch.full((3, *size), grey), calibration, spacing, 0.0)


@pytest.mark.parametrize("sensor", SIMULATED)
def test_no_contact_shows_the_background(sensor):
    unit = draw_instance(sensor, 5, SIZE, markers=False, randomise="none")
    picture = Optics(unit).render(torch.zeros(1, *SIZE))[0]
    assert torch.equal(picture, (unit.background + 0.5).to(torch.uint8))


@pytest.mark.parametrize("name", lighting.optics_names())
def test_light_that_is_turned_with_the_dent_shows_the_turned_picture(name):
    """A quarter turn: normals, places and slopes are turned exactly."""
    how = lighting.load_optics(name)
    everywhere = torch.zeros_like(how.fine[:, :, :1])
    everywhere[:, 0] = 1
    flat = replace(
        how,
        fine=how.fine * everywhere,
        coarse=0 * how.coarse[:9],
        limits=how.limits[:9],
        lights=(),
    )
    turned = flat.turned([math.pi / 2] * 3)
    dent = bump(2.5, -1.5, size=(60, 60)) + bump(-3, 2, depth=0.5, size=(60, 60))
    seen = Optics(plain(flat, (60, 60))).render(dent).int()
    other = Optics(plain(turned, (60, 60))).render(dent.rot90(-1, (1, 2))).rot90(1, (2, 3)).int()
    assert (seen - other).abs().max() <= 1
    assert (seen - 120).abs().max() > 20


@pytest.mark.parametrize("name", lighting.optics_names())
def test_mirrored_dent_under_mirrored_lights_gives_the_mirrored_picture(name):
    unit = plain(lighting.load_optics(name))
    other = replace(unit, calibration=unit.calibration.mirrored())
    dent = bump(2.5, -1.5) + bump(-3, 2, depth=0.5)
    seen = Optics(unit).render(dent).int()
    mirrored = Optics(other).render(dent.flip(-1)).flip(-1).int()
    assert (seen - mirrored).abs().max() <= 1
    assert (seen - seen.flip(-1)).abs().max() > 20  # the scene is not its own mirror image


def test_backgrounds_are_mirrored_too():
    how = lighting.load_optics("digit")
    seen = lighting.polynomial_background(how.backgrounds[0], *SIZE)
    mirrored = lighting.polynomial_background(how.mirrored().backgrounds[0], *SIZE)
    torch.testing.assert_close(mirrored, seen.flip(-1), atol=0.01, rtol=0)


@pytest.mark.parametrize("sensor", ["gelsight", "dm"])
def test_a_batch_is_its_frames(sensor):
    optics = Optics(draw_instance(sensor, 2, SIZE))
    dents = torch.cat([bump(i - 5, depth=0.1 * i) for i in range(11)])
    together = optics.render(dents, first=100)
    alone = torch.cat([optics.render(dents[i : i + 1], first=100 + i) for i in range(11)])
    assert (together.int() - alone.int()).abs().max() <= 1
    assert (together != alone).float().mean() < 1e-3


def test_same_seed_same_bytes():
    dent = bump()
    frames = [
        Optics(draw_instance("digit", seed, SIZE)).render(dent, first=4) for seed in (3, 3, 4)
    ]
    assert torch.equal(frames[0], frames[1])
    assert not torch.equal(frames[0], frames[2])


def test_noise_is_as_strong_as_the_unit_says_and_new_in_each_frame():
    unit = replace(plain(lighting.load_optics("digit")), noise=3.0)
    frames = Optics(unit).render(torch.zeros(4, *SIZE), first=0).float()
    assert (frames - 120).std() == pytest.approx(math.sqrt(3**2 + 1 / 12), rel=0.03)
    both = torch.corrcoef(frames.flatten(1))
    assert (both - torch.eye(4)).abs().max() < 0.05


@pytest.mark.parametrize("degrees", [0, 90, 135, -120])
def test_the_side_that_faces_the_lamp_is_bright(degrees):
    angle = math.radians(degrees)
    lamp = Lamp(angle, math.radians(30), (100, 100, 100), shadow=0.0)
    change = Optics(plain(lamp_calibration([lamp], (0, 0, 0)))).render(bump())[0, 0].float() - 120
    x, y = torch.linspace(-1, 1, SIZE[1]) * SIZE[1], torch.linspace(-1, 1, SIZE[0]) * SIZE[0]
    weight = change.abs()
    bright = torch.atan2((change * y[:, None]).sum(), (change * x).sum())
    assert weight.max() > 15
    assert math.cos(float(bright) - angle) > 0.98


def test_shadow_falls_behind_what_blocks_the_light():
    lamps = [Lamp(0.0, math.radians(30), (100, 100, 100), shadow=s) for s in (0.0, 0.5)]
    without, cast = (Optics(plain(lamp_calibration([lamp], (0, 0, 0)))) for lamp in lamps)
    dent = bump(depth=1.5)
    darker = without.render(dent)[0, 0].float() - cast.render(dent)[0, 0].float()
    left, right = darker[:, : SIZE[1] // 2], darker[:, SIZE[1] // 2 :]
    assert left.max() > 10
    assert left.sum() > 10 * right.sum().clamp(min=1)


def test_lamps_follow_lambert_where_the_normal_is_known():
    lamp = Lamp(0.0, math.radians(40), (100.0, 100.0, 100.0), fall=0.0, shadow=0.0)
    rise = 0.3 * 0.2 * torch.arange(SIZE[1]).expand(1, *SIZE)
    picture = Optics(plain(lamp_calibration([lamp], (0, 0, 0)))).render(rise)[0, 0, 30, 40]
    facing = (math.sin(lamp.elevation) - 0.3 * math.cos(lamp.elevation)) / math.hypot(1, 0.3)
    assert float(picture) == pytest.approx(120 + 100 * (facing - math.sin(lamp.elevation)), abs=2)


def test_a_picture_twice_as_large_shows_the_same():
    how = lighting.load_optics("gelsight")
    small = Optics(plain(how)).render(bump())
    large = Optics(plain(how, (120, 160), spacing=0.1)).render(bump(size=(120, 160), spacing=0.1))
    shrunk = F.avg_pool2d(large.float(), 2)
    assert (shrunk - small).abs().mean() < 0.5
    assert (small.float() - 120).abs().max() > 20


@pytest.mark.parametrize("sensor", SIMULATED)
def test_cliffs_and_depths_stay_tame(sensor):
    optics = Optics(draw_instance(sensor, 0, SIZE, markers=False))
    dent = torch.zeros(1, *SIZE)
    dent[:, 20:40, 30:50] = 4.0
    out = optics._light(dent, None)
    assert torch.isfinite(out).all()
    still = optics.render(0 * dent)[0].float()
    change = (optics.render(dent)[0].float() - still).abs()
    assert change[:, 20:40, 30:50].max() > 10
    assert change[:, :, :4].mean() < 15  # far from the contact


def test_normals_of_a_plane():
    slope = torch.arange(10.0).expand(1, 8, 10) * 0.5 * 0.1 + torch.zeros(1, 8, 10)
    x, y = normals(slope, 0.1)
    assert float(x[0, 4, 5]) == pytest.approx(0.5 / math.hypot(1, 0.5), rel=1e-5)
    assert y.abs().max() == 0
    assert float(normals(slope * 1e5, 0.1, steepest=0.5)[0][0, 4, 5]) == pytest.approx(0.5)


def test_places_are_the_polynomials_they_say():
    x, y = -1 + 3 / 4, -1 + 5 / 3  # of the second of 4 columns, and the last of 3 rows
    for power, place in zip(exponents(3), places(3, 4, 3), strict=True):
        assert float(place[2, 1]) == pytest.approx(x ** power[0] * y ** power[1])


def test_wrong_size_is_said():
    with pytest.raises(ConfigError, match=r"dents are \(10, 10\) pixels.*\(60, 80\)"):
        Optics(draw_instance("digit", 0, SIZE)).render(torch.zeros(1, 10, 10))


def test_unknown_calibration():
    with pytest.raises(ConfigError, match="did you mean 'digit'"):
        lighting.load_optics("digits")


@pytest.mark.parametrize("name", lighting.optics_names())
def test_shipped_calibrations_are_whole(name):
    how = lighting.load_optics(name)
    assert how.fine.shape == (len(POWERS), 6, 3)
    assert how.coarse.shape == (3 * len(BLURS) + len(how.lights), 6, 3)
    assert how.limits.shape == (len(how.coarse),)
    assert how.backgrounds.shape[1:] == (28, 3)
    assert 0 < how.noise < 5


@pytest.mark.gpu
@pytest.mark.skipif(not torch.cuda.is_available(), reason="no GPU")
def test_gpu_agrees():
    unit = draw_instance("duragel", 1, SIZE)
    dent = bump()
    here = Optics(unit).render(dent, first=0)
    there = Optics(unit, "cuda").render(dent.cuda(), first=0).cpu()
    assert (here.int() - there.int()).abs().max() <= 1
