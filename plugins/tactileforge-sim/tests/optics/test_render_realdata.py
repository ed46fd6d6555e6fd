import os
from pathlib import Path

import pytest
import torch
from tactileforge_depth import fit, lighting
from tactileforge_depth.features import places
from tactileforge_depth.presses import KNOWN, read_known
from tactileforge_sim.optics.render import Optics
from tactileforge_sim.optics.sensor_instances import SensorInstance

ROOT = Path(__file__).parents[4]
DATA = Path(os.environ.get("TACTILEFORGE_REALDATA", ROOT.parent / "shared" / "realdata"))

pytestmark = [
    pytest.mark.realdata,
    pytest.mark.skipif(not (DATA / "taxim_calibration").is_dir(), reason="no real data"),
]


def psnr(presses, pictures):
    """Mean over presses of the PSNR in the crop, dB."""
    ratios = []
    for i, picture in enumerate(pictures):
        wrong = (picture.float() - presses.pictures[i])[:, *presses.crop(i)]
        ratios.append(10 * torch.log10(255**2 / wrong.square().mean()))
    return float(torch.stack(ratios).mean())


def rendered(presses, calibration):
    optics = Optics(SensorInstance("", 0, presses.background, calibration, presses.spacing, 0.0))
    return [optics.render(presses.dent(i))[0] for i in range(len(presses))]


def linear(train, test):
    """Pictures by a model linear in the normal."""
    weights = fit.fit_weights(train, [f[:2] for f in fit.press_features(train, ())], 0, 1e-6)
    maps = torch.einsum("kpc,phw->kchw", weights, places(*train.size, 0))
    seen = [f[:2] for f in fit.press_features(test, ())]
    return [test.background + (maps * feature[:, None]).sum(0) for feature in seen]


def test_crop_is_the_one_of_the_published_baseline():
    test = read_known("gelsight", DATA).part(slice(1, None, 2))
    assert psnr(test, [test.background] * len(test)) == pytest.approx(21.55, abs=0.01)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "least"),
    [("gelsight", 32.0), ("gelsight_mini", 33.0), ("gelsight_fots", 28.0), ("digit", 27.5)],
)
def test_held_out_presses_are_met_better_than_by_simpler_models(name, least):
    presses = read_known(name, DATA)
    train, test = presses.part(slice(0, None, 4)), presses.part(slice(1, None, 8))
    ours = psnr(test, rendered(test, fit.fit_optics(train)))
    assert ours > least
    assert ours > psnr(test, [test.background] * len(test)) + 8
    assert ours > psnr(test, linear(train, test)) + 2


@pytest.mark.slow
@pytest.mark.parametrize("name", KNOWN)
def test_shipped_numbers_are_those_of_the_pictures(name):
    presses = read_known(name, DATA).part(slice(0, None, 6))
    how = lighting.load_optics(name)
    assert psnr(presses, rendered(presses, how)) > 29.5
    ground = lighting.polynomial_background(how.backgrounds[0], *presses.size)
    assert (ground - presses.background).abs().mean() < 6
