"""Reference presses make pictures of units of different contrast alike."""

import numpy as np
import pytest
from tactileforge_policies.envs.chip import Chip
from tactileforge_policies.envs.fingers import FINGERS
from tactileforge_policies.reference import NOMINAL, reference_gain, with_gain

from tactileforge.errors import DataError


def gains(env) -> dict[str, float]:
    rest, press = env.background(), env.reference()
    return {name: reference_gain(rest[name], press[name], name) for name in FINGERS}


def squeezed(unit: int):
    """The chip between gels of unequal contrast alone, and the gains of the fingers."""
    env = Chip(unit=unit, size=48, randomise=["contrast"])
    env.reset(seed=3)
    env.grip.place(np.zeros(3), env.grip.narrowest() + 1.4)
    return env.background(), env._fingers.pictures(env.held.moment), gains(env)


def test_units_of_different_contrast_answer_alike_after_the_gain() -> None:
    # Of these, the right finger of the first has 2.2 times the contrast of the second's.
    units = [squeezed(unit) for unit in (0, 1)]
    ratio = units[0][2]["right"] / units[1][2]["right"]
    assert max(ratio, 1 / ratio) > 1.5
    changes = {}
    for what in ("raw", "gain"):
        for name in FINGERS:
            changes[what, name] = []
            for rest, touch, gain in units:
                shown = touch[name]
                if what == "gain":
                    shown = with_gain(shown, rest[name], gain[name])
                changes[what, name].append(np.abs(shown.astype(float) - rest[name]).mean())
    raw, same = (
        max(changes[what, "right"]) / min(changes[what, "right"]) for what in ("raw", "gain")
    )
    assert raw > 1.5
    assert same < 1.1


def test_twice_the_contrast_gives_the_same_picture() -> None:
    rng = np.random.default_rng(0)
    rest = rng.integers(90, 160, (32, 32, 3)).astype(np.uint8)
    change = 2 * rng.integers(-15, 16, (32, 32, 3))
    press = rng.integers(-20, 21, (32, 32, 3))
    once, twice = (rest + k * change // 2 for k in (1, 2))
    gain, double = (
        reference_gain(rest, (rest + k * press).astype(np.uint8), "left") for k in (1, 2)
    )
    assert double == pytest.approx(2 * gain)
    assert gain == pytest.approx(np.sqrt((press**2).mean()) / NOMINAL)
    shown = [with_gain(np.uint8(x), rest, g) for x, g in ((once, gain), (twice, double))]
    assert np.abs(shown[0].astype(int) - shown[1]).max() <= 1


def test_a_press_changes_no_episode_and_is_the_same_each_time() -> None:
    plain, pressed = Chip(size=32), Chip(size=32)
    first = pressed.reference()
    for env in (plain, pressed):
        env.reset(seed=5)
    np.testing.assert_array_equal(first["left"], Chip(size=32).reference()["left"])
    for _ in range(2):
        seen = [env.step(np.array([0, 0, -0.3]))[0] for env in (plain, pressed)]
        for name in FINGERS:
            np.testing.assert_array_equal(seen[0][name], seen[1][name])


def test_what_is_no_press_is_refused() -> None:
    rest = np.full((8, 8, 3), 100, np.uint8)
    with pytest.raises(DataError, match="reference press of left: it changes the picture by 0 "):
        reference_gain(rest, rest, "left")
    with pytest.raises(
        DataError, match=r"reference press of left: \(4, 4, 3\), and its background"
    ):
        reference_gain(rest, rest[:4, :4], "left")
