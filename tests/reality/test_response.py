"""The response to force is found on data with a known one."""

import numpy as np
import pytest
from reality import measures
from reality.response import fitted, response

from tactileforge.contracts import Recording
from tactileforge.data.frames.lazy import ArrayFrames

COUNT, HEIGHT, WIDTH = 240, 60, 80


def trial() -> tuple[np.ndarray, np.ndarray]:
    """Forces (T, 3) of press, slides forth and back along y and x, lift; and place (T, 2)."""
    t = np.linspace(0, 1, COUNT)
    normal = 5 * np.clip(np.minimum(t, 1 - t) / 0.1, 0, 1) + 0.4 * np.sin(40 * t)
    shear, place = np.zeros((2, 2, COUNT))
    for axis, start in ((1, 0.1), (0, 0.5)):
        phase = np.clip((t - start) / 0.4, 0, 1)
        there = (phase > 0) & (phase < 1)
        place[axis] = 6 * np.sin(np.pi * phase)
        shear[axis] = 2 * np.tanh(8 * np.cos(np.pi * phase)) * there
    force = np.stack([*shear, np.maximum(normal, 0)], axis=1)
    return force, place.T


#: What shear along x, shear along y and normal force do to red, green and blue of the imprint. The
#: sum of the first two is 0: what makes the imprint as a whole brighter or moves it is no answer.
CHANNELS = np.array([[1.0, 0.0, -1.0], [0.5, -1.0, 0.5], [1.0, 1.0, 1.0]])


def changes(
    force: np.ndarray, place: np.ndarray, slopes: tuple[float, float, float], noise: float = 0.0
) -> np.ndarray:
    """A moving round imprint, brighter by normal force, and coloured by shear."""
    y, x = np.mgrid[:HEIGHT, :WIDTH].astype(np.float64)
    rng = np.random.default_rng(0)
    out = []
    for newton, (right, down) in zip(force, place, strict=True):
        bump = np.exp(-((x - 40 - right) ** 2 + (y - 30 - down) ** 2) / 100)
        out.append(bump[..., None] * ((newton * slopes) @ CHANNELS))
    drawn = np.stack(out)
    return (drawn + rng.normal(0, noise or 1e-9, drawn.shape)).astype(np.float32)


def one_newton(axis: int) -> float:
    """Root mean square over the contact of the effect of one newton at a slope of 1."""
    y, x = np.mgrid[:HEIGHT, :WIDTH].astype(np.float64)
    bump = np.exp(-((x - 40) ** 2 + (y - 30) ** 2) / 100)
    touched = measures.contact(np.repeat((30 * bump)[..., None], 3, axis=2).astype(np.float32))
    return float(np.sqrt(np.square(bump[touched]).mean() * np.square(CHANNELS[axis]).mean()))


@pytest.mark.parametrize("noise", [0.0, 2.0])
def test_known_slopes_are_found(noise):
    force, place = trial()
    fit = fitted(changes(force, place, (1.5, 0.8, 6.0), noise), force)
    assert fit.normal == pytest.approx(6.0 * one_newton(2), rel=0.03)
    assert fit.shear[0] == pytest.approx(1.5 * one_newton(0), rel=0.05)
    assert fit.shear[1] == pytest.approx(0.8 * one_newton(1), rel=0.05)


def test_a_picture_that_does_not_answer_to_shear_shows_none():
    force, place = trial()
    still = fitted(changes(force, place, (0.0, 0.0, 6.0), 2.0), force)
    assert max(still.shear) < 0.06, "the imprint moves, and that is no answer"
    answer = fitted(changes(force, place, (0.5, 0.5, 6.0), 2.0), force)
    assert min(answer.shear) > 4 * max(still.shear)


def test_the_curve_is_that_of_the_change_against_force():
    force, place = trial()
    fit = fitted(changes(force, place, (0.0, 0.0, 6.0)), force)
    assert fit.curve[1] == pytest.approx(0.5, abs=0.1)
    assert fit.curve[0] < fit.curve[1] < fit.curve[2] < 1


def test_a_trial_without_force_or_shear_or_touch_tells_nothing():
    force, place = trial()
    seen = changes(force, place, (1.0, 1.0, 6.0))
    pressed = force * np.array([0, 1, 1])
    assert np.isnan(fitted(changes(pressed, place, (1, 1, 6.0)), pressed).shear[0])
    assert fitted(seen[:30], force[:30]) is None
    assert fitted(seen * 0, force) is None
    pictures = ArrayFrames(np.full((COUNT, HEIGHT, WIDTH, 3), 90, np.uint8))
    given = {"key": "a/b", "sensor": "digit", "frames": pictures, "times": np.arange(COUNT) / 30}
    assert response(Recording(**given, no_contact=None, force=force.astype(np.float32))) is None
    assert response(Recording(**given, no_contact=pictures)) is None
    assert response(Recording(**given, no_contact=pictures, force=force.astype(np.float32))) is None
