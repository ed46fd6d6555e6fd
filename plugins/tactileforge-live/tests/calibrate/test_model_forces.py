"""Forces of a model, calibrated to one unit."""

import warnings
from dataclasses import replace
from importlib.resources import files
from pathlib import Path

import numpy as np
import pytest
import torch
from omegaconf import OmegaConf
from tactileforge_live.calibrate.calibrate import CalibrateOptions, CalibrationResult, calibrate
from tactileforge_live.calibrate.page import calibration_page

import tactileforge
from tactileforge.contracts import Recording
from tactileforge.data.frames.lazy import ArrayFrames
from tactileforge.datasets.recordings import Recordings
from tactileforge.encoders.tactile_vit import TactileViT
from tactileforge.errors import ConfigError
from tactileforge.heads.force import ForceHead
from tactileforge.hub.files import make_header
from tactileforge.hub.model import Model
from tactileforge.sensors.calibration.file import (
    Calibration,
    ForceAxis,
    ForceModel,
    parse_calibration,
)

pytestmark = pytest.mark.filterwarnings("ignore:force. an estimate")

NODE = {"name": "tactile_vit", "size": "tiny", "frames": 4, "image_size": 32}
SCALE = {"digit": [20.0, 20.0, 40.0], "gelsight": [20.0, 20.0, 40.0]}
PUBLIC = Path(str(files("tactileforge_datasets.conf") / "data/public_samples.yaml"))


@pytest.fixture(scope="module")
def model() -> Model:
    torch.manual_seed(0)
    encoder = TactileViT(**{key: value for key, value in NODE.items() if key != "name"})
    head = ForceHead(encoder)
    for part in (head.force, head.delta):  # so that an untrained one says something
        torch.nn.init.normal_(part.probe[-1].weight, std=0.05)
    heads = {"force": {"node": {"name": "force"}, "scale": SCALE}}
    header = make_header(encoder, NODE, licence="MIT", spacing=1 / 15, heads=heads)
    return Model(encoder.requires_grad_(False), header, None, "cpu", {"force": head})


def touches(model: Model, count: int = 6, noise: float = 0.02) -> list[Recording]:
    """Forces are 1.5 times the model's plus 0.3 N along z; shear is another mixture."""
    rng = np.random.default_rng(0)
    made = []
    for number in range(count):
        still = rng.integers(90, 150, (1, 32, 32, 3)).astype(np.uint8)
        dents = rng.normal(0, 40, (2, 32, 32, 3))
        phases = np.sin(np.linspace(0, [3, 5], 20) + rng.uniform(0, 6, 2))
        frames = (still + np.einsum("tk,khwc->thwc", phases, dents)).clip(0, 255).astype(np.uint8)
        recording = Recording(
            key=f"press{number}",
            sensor="digit",
            frames=ArrayFrames(frames),
            times=np.arange(20) / 15,
            no_contact=ArrayFrames(still),
            force=np.zeros((20, 3), np.float32),
            labels={"unit": "D1"},
        )
        said = np.stack([model_says(model, recording, axis) for axis in "xyz"], 1)
        true = np.stack([said[:, 0] - 2 * said[:, 1], said[:, 1], 1.5 * said[:, 2] + 0.3], 1)
        made.append(
            replace(recording, force=(true + rng.normal(0, noise, true.shape)).astype(np.float32))
        )
    return made


def model_says(model: Model, recording: Recording, axis: str) -> np.ndarray:
    rest = recording.no_contact.read([0])[0]
    frames = recording.frames.read(range(len(recording.frames)))
    rows = np.maximum(np.arange(20)[:, None] - np.arange(3, -1, -1), 0)
    said = model.force(frames[rows], rest, "digit", unit="uncalibrated")
    return said.numpy()[:, -1, "xyz".index(axis)]


@pytest.fixture(scope="module")
def calibrated(model: Model) -> CalibrationResult:
    return calibrate(touches(model), CalibrateOptions(checks=False), model=model)


def test_gain_and_offset_of_a_unit_are_found(calibrated: CalibrationResult) -> None:
    force = calibrated.calibration.force
    assert force.of == "both"
    assert {name: axis.chosen for name, axis in force.axes.items()}["z"] == "head"
    z = force.axes["z"]
    assert z.weights["z"] == pytest.approx(1.5, abs=0.05)
    assert z.offset == pytest.approx(0.3, abs=0.05)
    assert z.rmse == pytest.approx(0.02, rel=0.3)  # the noise
    assert force.axes["x"].weights["y"] == pytest.approx(-2, abs=0.2)  # axes that are mixed
    truth = calibrated.fits["z"].measured
    assert z.before == pytest.approx(np.sqrt(np.mean((truth - (truth - 0.3) / 1.5) ** 2)), rel=0.1)
    assert z.before > 5 * z.rmse


def test_the_model_gives_calibrated_forces(model: Model, calibrated: CalibrationResult) -> None:
    touch = touches(model, 7)[6]
    rest, frames = touch.no_contact.read([0])[0], touch.frames.read(range(20))
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # no estimate any more
        given = model.force(frames[8:12], rest, "digit", calibration=calibrated.calibration)[-1]
    assert given.numpy() == pytest.approx(touch.force[11], abs=0.1)
    told = calibrated.calibration.forces(touch, model)[11]
    assert np.isnan(told[1])  # the model is right already, and stays as it is
    assert told[[0, 2]] == pytest.approx(given[[0, 2]].numpy(), abs=1e-4)
    plain = model.readings(frames[8:12], rest, "digit")
    both = model.readings(frames[8:12], rest, "digit", calibration=calibrated.calibration)
    assert torch.equal(plain.vector, both.vector)
    assert not torch.allclose(plain.force, both.force, atol=0.1)
    assert (plain.force_unit, both.force_unit) == ("relative", "N")
    with pytest.raises(ConfigError, match="leave the calibration out, or the unit"):
        model.stream("digit", calibration=calibrated.calibration, force_unit="uncalibrated")


def test_the_model_reads_a_calibration_to_pictures(model: Model, tmp_path: Path) -> None:
    """A force may follow from pictures, from the head, or from both; a file says which."""
    touch = touches(model, 1)[0]
    weights = {"x": {"change": 0.25}, "z": {"z": 2.0, "red_00": -0.5}}
    axes = {key: ForceAxis(0.1, value, 0.1, 0.9, [0.0, 5.0]) for key, value in weights.items()}
    force = ForceModel("both", 0.0, axes, model.fingerprint)
    calibration = Calibration(sensor="digit", unit="D1", force=force)
    calibration.save(tmp_path / "d1.yaml")
    rest, frames = touch.no_contact.read([0])[0], touch.frames.read(range(20))
    given = model.force(frames[8:12], rest, "digit", calibration=tmp_path / "d1.yaml")[-1]
    plain = model.force(frames[8:12], rest, "digit", unit="uncalibrated")[-1]
    change = frames[11].astype(float) - rest
    assert float(given[0]) == pytest.approx(0.1 + 0.25 * np.abs(change).mean(), abs=1e-4)
    assert float(given[1]) == float(plain[1])
    red = change[..., 0].mean()
    assert float(given[2]) == pytest.approx(0.1 + 2 * float(plain[2]) - 0.5 * red, abs=1e-4)
    told = calibration.forces(touch, model)[11]
    assert told[[0, 2]] == pytest.approx(given[[0, 2]].numpy(), abs=1e-4)
    stream = model.stream("digit", background=rest, calibration=tmp_path / "d1.yaml")
    for number in range(8, 12):
        found = stream.push(frames[number], number / 15)
    assert found.force == pytest.approx(given.tolist(), abs=1e-4)
    assert found.force_unit == "N"


@pytest.mark.slow
def test_a_lamp_that_is_switched_on_while_pressing_gives_no_force(
    model: Model, tmp_path: Path
) -> None:
    """Beside a press at the middle; the range of the presses is in the file."""
    rest = np.full((1, 32, 32, 3), 100, np.uint8)
    dent = np.zeros((32, 32, 3))
    dent[12:16, 12:20], dent[16:20, 12:20] = 60, -60
    waves = [1 + np.sin(np.linspace(0, 6, 20) + phase) for phase in range(6)]
    recordings = [
        replace(
            touch,
            frames=ArrayFrames((rest + wave[:, None, None, None] * dent).astype(np.uint8)),
            no_contact=ArrayFrames(rest),
            force=np.outer(wave, [0, 0, 3]).astype(np.float32),
        )
        for touch, wave in zip(touches(model), waves, strict=True)
    ]
    made = calibrate(recordings, CalibrateOptions(checks=False, axes=["z"]), model=model)
    made.calibration.save(tmp_path / "d1.yaml")
    known = made.calibration.force.borders
    assert np.abs(known).max() < 0.5
    assert np.shape(known) == (2, 24)
    pressed = recordings[0].frames.read(range(4))
    across, down = np.meshgrid(*[np.linspace(0, 1, 32)] * 2)
    lamp = 14 * np.exp(-(across**2 + down**2) / 0.15)[..., None]
    lit = pressed.copy()
    lit[2:] = (pressed[2:] + lamp).clip(0, 255).astype(np.uint8)
    given = dict(background=rest[0], sensor="digit", calibration=tmp_path / "d1.yaml")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        force = model.force(pressed, **given)
    assert force[:, 2].numpy() == pytest.approx(3 * waves[0][1:4], abs=0.3)
    with pytest.warns(UserWarning, match="in none of the presses of the calibration, by another"):
        read = model.force(lit, **given)
    assert read.isnan().all(1).tolist() == [False, True, True]
    shown = replace(
        recordings[0], frames=ArrayFrames(lit), times=np.arange(4) / 15, force=None, labels={}
    )
    with pytest.warns(UserWarning, match=r"press0: 2 of 4 frames have no force \(NaN\)"):
        told = made.calibration.forces(shown, model)[:, 2]
    assert np.isnan(told).tolist() == [False, False, True, True]
    stream = model.stream("digit", background=rest[0], calibration=tmp_path / "d1.yaml")
    for number in range(4):
        found = stream.push(lit[number], number / 15)
    assert (found.trouble, found.force, found.slip) == ("other_light", None, None)
    flickering = model.stream("digit", background=rest[0], calibration=tmp_path / "d1.yaml")
    troubles = []
    for number, is_lit in enumerate([*[0] * 9, 1, 0, 1, 0, 1, *[0] * 10]):
        found = flickering.push((lit if is_lit else pressed)[3], number / 30)
        troubles.append("" if found is None else found.trouble)
    assert troubles[9] == troubles[11] == "other_light"
    assert troubles[10] == "", "one frame before it tells no flicker"
    assert troubles[13:16] == ["other_light"] * 3, "near its zero"
    assert troubles[-1] == "", "once it is over"
    # one that was made before the range was kept
    old = replace(made.calibration, force=replace(made.calibration.force, borders=[]))
    assert model.force(lit, rest[0], "digit", calibration=old).isfinite().all()


@pytest.mark.slow
def test_an_axis_that_is_left_out_stays_what_the_model_says(model: Model) -> None:
    alone = calibrate(
        touches(model), CalibrateOptions(checks=False, axes=["z"]), model=model
    ).calibration
    touch = touches(model, 1)[0]
    rest, frames = touch.no_contact.read([0])[0], touch.frames.read(range(4))
    plain = model.force(frames, rest, "digit", unit="uncalibrated")
    given = model.force(frames, rest, "digit", calibration=alone)
    assert torch.equal(plain[:, :2], given[:, :2])
    assert not torch.equal(plain[:, 2], given[:, 2])
    assert np.isnan(alone.forces(touch, model)[:, :2]).all()


def test_a_calibration_knows_its_model(model: Model, calibrated: CalibrationResult) -> None:
    text = calibrated.calibration.text()
    assert parse_calibration(text, "here") == calibrated.calibration
    touch = touches(model, 1)[0]
    with pytest.raises(ConfigError, match="were fitted to a model: give that model"):
        calibrated.calibration.forces(touch)
    frames, rest = touch.frames.read(range(4)), touch.no_contact.read([0])[0]
    with pytest.raises(ConfigError, match="that of digit D1, and this is gelsight"):
        model.force(frames, rest, "gelsight", calibration=calibrated.calibration)
    other = replace(
        calibrated.calibration, force=replace(calibrated.calibration.force, model="0" * 16)
    )
    with pytest.raises(ConfigError, match="was not fitted to the forces of this model"):
        model.force(frames, rest, "digit", calibration=other)
    with pytest.raises(ConfigError, match="fit=head needs a model: give model=NAME"):
        calibrate([touch], CalibrateOptions(checks=False, fit="head"))


def test_the_page_says_the_error_before_and_after(calibrated: CalibrationResult) -> None:
    page = calibration_page(calibrated)
    z = calibrated.calibration.force.axes["z"]
    assert "as it is" in page
    assert f"{z.before:.3g}" in page
    assert f"{z.rmse:.3g}" in page
    assert "Drawn faintly: the model as it is" in page


def trial(realdata: Path, name: str) -> Recording:
    layout = OmegaConf.to_container(OmegaConf.load(PUBLIC).data.layouts[name]) | {
        "hold_out": "none"
    }
    (recording,) = Recordings(str(realdata), {name: layout}).recordings("train")
    return recording


def rmse(predicted: np.ndarray, recording: Recording) -> float:
    assert recording.force is not None
    return float(np.sqrt(np.nanmean((predicted[:, 2] - recording.force[:, 2]) ** 2)))


#: A few frames of a trial are in another light than its presses, by the rule for borders.
FEW_MISSING = r"ignore:.* \d of \d+ frames have no force"


@pytest.mark.slow
@pytest.mark.filterwarnings(FEW_MISSING)
@pytest.mark.realdata
@pytest.mark.parametrize("name", ["touchd_force_gelsight_mini", "touchd_force_digit"])
def test_ten_seconds_of_a_real_trial_calibrate_the_rest(realdata: Path, name: str) -> None:
    """Normal force within a tenth of its range, and shear along the pressed axis."""
    recording = trial(realdata, name)
    count = 300  # frames, at 30/s
    first, rest = recording.part(0, count), recording.part(count, len(recording.frames))
    assert rest.force is not None
    done = calibrate([first], CalibrateOptions(checks=False, fit="pictures")).calibration
    assert rmse(done.forces(rest), rest) < 0.1 * np.nanmax(rest.force[:, 2])
    (left_out,) = done.force.left_out
    other = {"x": "y", "y": "x"}[left_out]
    column = "xyz".index(other)
    assert done.force.axes[other].chosen == "pictures"
    error = done.forces(rest)[:, column] - rest.force[:, column]
    level = np.nanmean(first.force[:, column]) - rest.force[:, column]
    assert np.nanmean(error**2) < 0.3 * np.nanmean(level**2)


@pytest.mark.slow
@pytest.mark.filterwarnings(FEW_MISSING)
@pytest.mark.realdata
@pytest.mark.parametrize("name", ["touchd_force_gelsight_mini", "touchd_force_digit"])
def test_shear_along_a_hardly_pressed_axis_is_read_with_the_scale_of_another(
    realdata: Path, name: str
) -> None:
    recording = trial(realdata, name)
    first, rest = recording.part(0, 300), recording.part(300, len(recording.frames))
    model = tactileforge.load("anytouch2.tiny")
    done = calibrate([first], CalibrateOptions(checks=False), model=model)
    force = done.calibration.force
    (axis,) = [axis for axis, found in force.axes.items() if found.chosen == "scaled"]
    assert force.left_out == {}
    (note,) = [note for note in done.notes if note.startswith(f"force {axis} is the model's times")]
    assert note.endswith("press along it too")
    column = "xyz".index(axis)
    truth = rest.force[:, column]
    said = done.calibration.forces(rest, model)[:, column]
    known = np.isfinite(truth) & np.isfinite(said)
    plain = said / force.axes[axis].weights[axis]
    scores = [
        1 - np.mean((values - truth)[known] ** 2) / np.var(truth[known]) for values in (said, plain)
    ]
    assert scores[0] > 0.5
    assert scores[1] < 0.25


@pytest.mark.slow
@pytest.mark.realdata
@pytest.mark.parametrize("name", ["touchd_force_gelsight_mini", "touchd_force_digit"])
def test_the_shipped_model_reads_real_forces(realdata: Path, name: str) -> None:
    """Zero shot, shear too: neither these units nor any real force was in its training."""
    recording = trial(realdata, name)
    model = tactileforge.load("anytouch2.tiny")
    ends = np.arange(6, len(recording.frames), 6)
    frames = recording.frames.read(range(len(recording.frames)))[
        ends[:, None] - np.array([6, 4, 2, 0])
    ]
    assert recording.no_contact is not None
    assert recording.force is not None
    background = recording.no_contact.read([0])[0]
    estimated = model.force(frames, background, recording.sensor, checks=False)
    estimated = estimated[:, -1].numpy()  # the DIGIT lies on its side, as its layout says
    for axis in range(3):
        assert np.corrcoef(estimated[:, axis], recording.force[ends, axis])[0, 1] > 0.5


@pytest.mark.slow
@pytest.mark.filterwarnings(FEW_MISSING)
@pytest.mark.realdata
def test_half_a_real_trial_calibrates_the_shipped_model(realdata: Path) -> None:
    """The first half in time gives the factors; the error of the second falls."""
    recording = trial(realdata, "touchd_force_gelsight_mini")
    middle = len(recording.frames) // 2
    first, second = recording.part(0, middle), recording.part(middle, len(recording.frames))
    model = tactileforge.load("anytouch2.tiny")
    result = calibrate([first], CalibrateOptions(checks=False, axes=["z"]), model=model)
    rows = np.maximum(np.arange(len(second.frames))[:, None] - np.array([6, 4, 2, 0]), 0)
    frames = second.frames.read(range(len(second.frames)))[rows]
    assert second.no_contact is not None
    rest = second.no_contact.read([0])[0]
    plain = model.force(frames, rest, second.sensor, unit="uncalibrated")[:, -1].numpy()
    assert rmse(result.calibration.forces(second, model), second) < 0.7 * rmse(plain, second)
