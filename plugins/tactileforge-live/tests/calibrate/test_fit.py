"""Fits of forces with known answers, judged on blocks of time."""

from dataclasses import replace

import cv2
import numpy as np
import torch
from tactileforge_live.calibrate.calibrate import CalibrateOptions, calibrate
from tactileforge_live.calibrate.fit import Candidate, fit_axis, folds, hardly_pressed
from tactileforge_live.calibrate.page import calibration_page

from tactileforge.contracts import Recording
from tactileforge.data.frames.lazy import ArrayFrames
from tactileforge.sensors.calibration.picture_features import PICTURE_FEATURES, picture_inputs

ROWS, COLUMNS = np.mgrid[-1:1:48j, -1:1:64j]
REST = np.full((48, 64, 3), 90, np.uint8)


def touch(depths: np.ndarray, rng: np.random.Generator) -> Recording:
    """Blobs of given strengths (T,), each at a place of its own, some of them dark."""
    places = rng.uniform(-0.6, 0.6, (len(depths), 2))
    away = (ROWS - places[:, :1, None]) ** 2 + (COLUMNS - places[:, 1:, None]) ** 2
    blobs = np.exp(-away / 0.05)[..., None] * rng.choice([-1, 1], (len(depths), 1, 1, 3))
    frames = (REST + depths[:, None, None, None] * blobs).round().clip(0, 255).astype(np.uint8)
    return Recording(
        key="touch",
        sensor="digit",
        frames=ArrayFrames(frames),
        times=np.arange(len(depths)) / 30,
        no_contact=ArrayFrames(REST[None]),
        force=np.zeros((len(depths), 3), np.float32),
    )


def mean_change(recording: Recording) -> np.ndarray:
    frames = recording.frames.read(range(len(recording.frames)))
    return np.abs(frames.astype(float) - REST).mean((1, 2, 3))


def with_force(recording: Recording, x: np.ndarray, z: np.ndarray) -> Recording:
    return replace(recording, force=np.stack([x, 0 * x, z], 1).astype(np.float32))


def test_a_force_that_is_the_mean_change_is_recovered() -> None:
    rng = np.random.default_rng(0)
    made = touch(rng.uniform(10, 80, 200), rng)
    z = 0.8 * mean_change(made) + 0.3 + rng.normal(0, 0.02, 200)
    result = calibrate([with_force(made, rng.normal(0, 1, 200), z)], CalibrateOptions())
    axis = result.calibration.force.axes["z"]
    assert axis.chosen == "change"
    assert abs(axis.weights["change"] / 0.8 - 1) < 0.01
    assert abs(axis.offset - 0.3) < 0.02
    assert axis.errors["change"] == axis.rmse < 0.1 * axis.errors["mean"]


def test_an_axis_that_nothing_explains_stays_as_it_was() -> None:
    rng = np.random.default_rng(1)
    made = touch(rng.uniform(10, 80, 200), rng)
    recording = with_force(made, rng.normal(0, 1, 200), 0.8 * mean_change(made))
    result = calibrate([recording], CalibrateOptions())
    force = result.calibration.force
    assert list(force.axes) == ["z"]
    assert np.isnan(result.calibration.forces(recording)[:, :2]).all()
    errors = force.left_out["x"]
    assert min(errors["change"], errors["pictures"]) > 0.98 * errors["mean"]
    first, second = result.notes
    assert "force x is left out: the best fit has an error of" in first
    assert "force y is left out: its range is 0 N" in second
    page = calibration_page(result)
    assert 'id="candidates"' in page
    assert f"{errors['pictures']:.3g}" in page
    assert "left out</td>" in page


def test_an_axis_that_was_hardly_pressed_is_left_out() -> None:
    """Small shear, told by pictures to the last: nothing was seen of larger ones."""
    forces = np.zeros((30, 3))
    forces[:, 2] = np.linspace(0, 10, 30)
    forces[:, 0] = np.linspace(-0.7, 0.7, 30)
    forces[:, 1] = np.linspace(0, 2, 30)
    forces[::7] = np.nan
    assert hardly_pressed(forces) == ["x"]
    assert hardly_pressed(np.full((30, 3), np.nan)) == ["x", "y", "z"]
    rng = np.random.default_rng(7)
    made = touch(rng.uniform(10, 80, 100), rng)
    change = mean_change(made)
    result = calibrate([with_force(made, 0.1 * change, change)], CalibrateOptions())
    assert list(result.calibration.force.axes) == ["z"]
    assert "press along it too" in result.notes[0]


def test_a_ramp_of_twenty_frames_is_accepted() -> None:
    ramp = np.linspace(1, 12, 20)
    made = touch(6 * ramp, np.random.default_rng(2))
    known = with_force(made, np.zeros(20), ramp)
    axis = calibrate([known], CalibrateOptions()).calibration.force.axes["z"]
    assert axis.r2 > 0.95
    assert axis.span == [1.0, 12.0]
    late = replace(known, times=np.arange(20) / 30, force=known.force.copy())
    late.force[:6] = np.nan  # as after a lag of 0.2 s
    assert calibrate([late], CalibrateOptions()).calibration.force.axes["z"].r2 > 0.9


def test_fits_are_judged_on_blocks_of_time() -> None:
    """Inputs tell the time and the force drifts: neighbours give it away, blocks do not."""
    rng = np.random.default_rng(3)
    time = np.arange(200)
    places = np.linspace(0, 199, 30)
    clock = np.exp(-((time[:, None] - places) ** 2) / 2 / 5**2)
    inputs = {f"t{i}": clock[:, i] for i in range(30)}
    force = np.cumsum(rng.normal(0, 1, 200))
    candidates = [Candidate("clock", [list(inputs)])]
    blocks = fit_axis(inputs, candidates, force, folds([200]), "z")
    assert blocks.axis is None
    assert blocks.errors["clock"] > 0.9 * blocks.errors["mean"]
    mixed = fit_axis(inputs, candidates, force, rng.integers(0, 5, 200), "z")
    assert mixed.axis is not None
    assert mixed.axis.r2 > 0.8


def test_a_tie_goes_to_the_simpler() -> None:
    rng = np.random.default_rng(4)
    inputs = {name: rng.normal(0, 1, 120) for name in ("a", *(f"n{i}" for i in range(10)))}
    wide = Candidate("wide", [["a"], [f"n{i}" for i in range(10)]])
    force = 2 * inputs["a"] + rng.normal(0, 0.5, 120)
    fit = fit_axis(inputs, [Candidate("one", [["a"]]), wide], force, folds([120]), "z")
    assert fit.axis.chosen == "one"
    assert abs(fit.axis.weights["a"] - 2) < 0.15
    better = force + inputs["n0"]
    assert fit_axis(
        inputs, [Candidate("one", [["a"]]), wide], better, folds([120]), "z"
    ).axis.chosen == ("wide")


def test_a_model_that_is_right_already_stays_as_it_is() -> None:
    rng = np.random.default_rng(5)
    z = rng.normal(0, 2, 150)
    inputs = {"z": z + rng.normal(0, 0.1, 150), "noise": rng.normal(0, 1, 150)}
    candidates = [Candidate("head", [["z"]]), Candidate("both", [["z"], ["noise"]])]
    fit = fit_axis(inputs, candidates, z, folds([150]), "z", "z")
    assert fit.axis is None
    assert fit.errors["as it is"] <= min(fit.errors["head"], fit.errors["both"]) / 0.98


def test_picture_inputs_are_the_lowest_cosines_of_the_coarse_change() -> None:
    rng = np.random.default_rng(6)
    frame, rest = rng.integers(0, 256, (2, 48, 64, 3)).astype(np.uint8)
    shown, still = (torch.from_numpy(x)[None].movedim(-1, -3) for x in (frame, rest))
    inputs = picture_inputs(shown, still)
    assert list(inputs) == list(PICTURE_FEATURES)
    assert len(PICTURE_FEATURES) == 33
    change = frame.astype(np.float64) - rest
    cells = cv2.resize(change, (8, 8), interpolation=cv2.INTER_AREA)
    for color, name in enumerate(("red", "green", "blue")):
        waves = cv2.dct(np.ascontiguousarray(cells[..., color])) / 8
        for i, j in ((0, 0), (1, 2), (3, 0), (0, 3)):
            np.testing.assert_allclose(inputs[f"{name}_{i}{j}"], waves[i, j], atol=1e-4)
    size = np.abs(change).mean(-1)
    for key, factor in (("change", 1), ("change_x", COLUMNS), ("change_y", ROWS)):
        np.testing.assert_allclose(inputs[key], (size * factor).mean(), rtol=1e-4, atol=1e-4)
