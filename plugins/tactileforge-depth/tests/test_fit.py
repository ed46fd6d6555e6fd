import json
import math
from dataclasses import replace

import cv2
import numpy as np
import pytest
import torch
from tactileforge_depth import fit, lighting
from tactileforge_depth.presses import Presses, ball_profile, find_circle, read_presses
from tactileforge_sim.optics.render import Optics
from tactileforge_sim.optics.sensor_instances import SensorInstance

from tactileforge.errors import DataError, DataNotFoundError

SIZE = (120, 160)
CIRCLES = [
    (x, y, r)
    for x, y, r in zip(
        [40, 80, 120, 60, 100, 50, 110, 85],
        [40, 60, 80, 85, 35, 60, 60, 90],
        [11, 14, 12, 13, 15, 12, 13, 14],
        strict=True,
    )
]


def presses(name="gelsight", noise=0.0):
    """Presses made by the optics of a shipped calibration."""
    how = lighting.load_optics(name)
    ground = lighting.polynomial_background(how.backgrounds[0], *SIZE)
    blank = torch.zeros(len(CIRCLES), 3, *SIZE, dtype=torch.uint8)
    made = Presses(ground, blank, torch.tensor(CIRCLES).float(), 0.118, steepest=how.steepest)
    optics = Optics(SensorInstance("", 1, ground, how, made.spacing, noise))
    dents = torch.cat([made.dent(i) for i in range(len(CIRCLES))])
    return replace(made, pictures=optics.render(dents, first=0))


def error(made, calibration, numbers):
    """Root mean square error in the crops, grey levels."""
    optics = Optics(SensorInstance("", 1, made.background, calibration, made.spacing, 0.0))
    wrong = [
        (optics.render(made.dent(i))[0].float() - made.pictures[i])[:, *made.crop(i)]
        for i in numbers
    ]
    return math.sqrt(np.mean([float(w.square().mean()) for w in wrong]))


@pytest.mark.slow
def test_fit_finds_the_calibration_that_made_the_pictures():
    made = presses()
    fitted = fit.fit_optics(made.part(slice(0, 6)))
    contrast = (made.pictures[7] - made.background)[:, *made.crop(7)].std()
    assert contrast > 15
    assert error(made, fitted, [6, 7]) < 0.15 * float(contrast)
    # Colours shine from where they shone.
    turn = np.subtract(fitted.lights, lighting.load_optics("gelsight").lights)
    assert np.cos(turn).min() > 0.9


@pytest.mark.slow
def test_noise_is_measured():
    assert fit.camera_noise(presses(noise=3.0)) == pytest.approx(3 / math.sqrt(2), rel=0.15)


@pytest.mark.slow
@pytest.mark.parametrize("radius", [0.7, 1.2, 1.7])
def test_gel_takes_the_balls_shape_in_the_contact_and_flattens_outside(radius):
    far, depth = ball_profile(2.0, 4.0, radius)
    half = np.interp(radius / 2, far, depth)
    fall = 2 - math.sqrt(4 - radius**2 / 4)
    assert depth[0] - half == pytest.approx(fall, rel=0.03, abs=0.005)
    assert (np.diff(depth[: int(2 / 0.06)]) < 0).all()
    assert abs(np.interp(4 * radius, far, depth)) < 0.2 * depth[0]


def test_background_is_a_polynomial_of_the_place():
    how = lighting.load_optics("digit")
    picture = lighting.polynomial_background(how.backgrounds[1], *SIZE)
    weights = fit.fit_background(picture)
    again = lighting.polynomial_background(weights, 60, 80)
    expected = lighting.polynomial_background(how.backgrounds[1], 60, 80)
    torch.testing.assert_close(again, expected, atol=0.1, rtol=0)


def test_circle_is_found():
    ground = torch.full((3, 90, 120), 100.0)
    y, x = torch.meshgrid(torch.arange(90), torch.arange(120), indexing="ij")
    disc = torch.hypot(x - 70.0, y - 40.0) < 18
    speck = torch.hypot(x - 20.0, y - 70.0) < 3
    picture = ground + 80.0 * disc - 60.0 * speck
    assert find_circle(picture, ground) == pytest.approx((70, 40, 18), abs=1.5)


def test_saved_calibration_is_the_one_that_is_loaded(tmp_path):
    how = lighting.load_optics("digit")
    fit.save_optics(how, tmp_path / "digit.json", "a test")
    assert json.loads((tmp_path / "digit.json").read_text())["source"] == "a test"
    again = lighting.parse_optics((tmp_path / "digit.json").read_text())
    torch.testing.assert_close(again.fine, how.fine)
    torch.testing.assert_close(again.coarse, how.coarse)
    torch.testing.assert_close(again.backgrounds, how.backgrounds)
    assert again.lights == how.lights


def test_presses_are_read_with_and_without_annotations(tmp_path):
    ground = np.full((60, 80, 3), (90, 120, 150), np.uint8)
    cv2.imwrite(str(tmp_path / "still.png"), ground)
    for name, x in (("press1.png", 30), ("press2.png", 50)):
        picture = ground.copy()
        cv2.circle(picture, (x, 25), 9, (20, 220, 30), -1)
        cv2.imwrite(str(tmp_path / name), picture)
    rows = "file,center_x_px,center_y_px,radius_px\npress2.png,50,25,9\n"
    (tmp_path / "known.csv").write_text(rows)
    known = read_presses(tmp_path, "still.png", 0.1, "known.csv")
    loaded = read_presses(tmp_path, "still.png", 0.1, pictures="press*.png", share=0.5)
    assert known.background[:, 0, 0].tolist() == [150, 120, 90]  # RGB
    assert len(known) == 1
    assert len(loaded) == 2
    assert loaded.share == 0.5
    assert loaded.circles[1].tolist() == pytest.approx(known.circles[0].tolist(), abs=1.5)


def test_missing_and_broken_pictures_are_named(tmp_path):
    with pytest.raises(DataNotFoundError, match=r"still\.png does not exist"):
        read_presses(tmp_path, "still.png", 0.1)
    (tmp_path / "still.png").write_text("nothing")
    with pytest.raises(DataError, match=r"still\.png is not an image"):
        read_presses(tmp_path, "still.png", 0.1)
