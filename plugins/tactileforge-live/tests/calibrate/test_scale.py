"""The scale of a unit, from one axis of the force to another."""

from dataclasses import replace

import numpy as np
import pytest
from tactileforge_live.calibrate.fit import AxisFit, fit_axis, folds
from tactileforge_live.calibrate.force import candidates, keep_axes
from tactileforge_live.calibrate.scale import SCALED, share_scale

N = 100
TURNS = (31, 47, 23)
SAID = {
    axis: 2 * np.sin(np.linspace(0, turns, N)) for axis, turns in zip("xyz", TURNS, strict=True)
}


def fits(factors: dict[str, float], noise: float = 0.05) -> dict[str, AxisFit]:
    """Fits to the model's forces times a factor."""
    rng = np.random.default_rng(0)
    fold, found = folds([N]), {}
    for axis, factor in factors.items():
        force = factor * SAID[axis] + rng.normal(0, noise, N)
        found[axis] = fit_axis(SAID, candidates("head", axis, SAID), force, fold, axis, axis)
    return found


def test_a_hardly_pressed_axis_takes_the_scale_of_the_other_shear_axis() -> None:
    made = fits({"x": 3.0, "y": 0.02, "z": 2.0})
    kept, (note,) = keep_axes(made, ["y"])
    assert list(kept) == ["x", "y", "z"]
    assert kept["x"] is made["x"]
    y = kept["y"].axis
    assert y.chosen == SCALED
    assert y.offset == 0
    assert y.weights == {"y": pytest.approx(3, abs=0.02)}
    assert y(SAID) == pytest.approx(3 * SAID["y"], rel=0.01)
    # the error on its own frames, which hold no force: all of the model's, three times
    assert y.rmse == pytest.approx(3 * np.sqrt(np.mean(SAID["y"] ** 2)), rel=0.02)
    assert y.errors["as it is"] == pytest.approx(y.rmse / 3, rel=0.1)
    assert "force y is the model's times 3" in note
    assert "the scale of x" in note


def test_without_shear_it_is_the_scale_of_the_normal_force() -> None:
    kept, notes = keep_axes(fits({"x": 0.02, "y": 0.02, "z": 2.0}), ["x", "y"])
    assert [kept[axis].axis.weights[axis] for axis in "xy"] == pytest.approx([2, 2], abs=0.02)
    assert all("the scale of z" in note for note in notes)


def test_the_normal_force_takes_no_scale_of_shear() -> None:
    kept, (note,) = keep_axes(fits({"x": 3.0, "y": 3.0, "z": 0.02}), ["z"])
    assert list(kept) == ["x", "y"]
    assert note.startswith("force z is left out")


def test_a_model_which_is_right_keeps_its_scale() -> None:
    made = fits({"x": 1.0, "y": 0.02})
    assert share_scale(made["x"], made["y"], "y", pressed=False) is None


def test_a_reversed_axis_does_not_reverse_another() -> None:
    made = fits({"x": -3.0, "y": 0.02})
    assert share_scale(made["x"], made["y"], "y", pressed=False) is None


def test_the_note_on_a_pressed_axis_asks_for_more_presses() -> None:
    made = fits({"x": 3.0, "y": 2.5})
    kept, (note,) = keep_axes(made | {"y": replace(made["y"], axis=None)}, [])
    assert kept["y"].axis.chosen == SCALED
    assert note.endswith("the scale of x: no candidate explains it; record more presses")


@pytest.mark.parametrize(("own", "taken"), [(2.5, True), (1.0, False), (-3.0, False)])
def test_a_pressed_axis_judges_the_scale(own: float, taken: bool) -> None:
    made = fits({"x": 3.0, "y": own})
    assert (share_scale(made["x"], made["y"], "y", pressed=True) is not None) == taken


def test_without_a_model_or_a_measured_force_there_is_no_scale() -> None:
    made = fits({"x": 3.0, "y": 0.0}, noise=0.0)
    assert share_scale(made["x"], made["y"], "y", pressed=False) is None
    force, fold = 3 * SAID["x"], folds([N])
    alone = fit_axis(SAID, candidates("head", "x", SAID), force, fold, "x")
    assert share_scale(alone, fits({"y": 0.02})["y"], "y", pressed=False) is None
