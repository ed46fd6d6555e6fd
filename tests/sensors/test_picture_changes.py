"""Rolled, turned or recoloured pictures are noticed; touch and light are not."""

import numpy as np
import pytest

from tactileforge.contracts import Frame
from tactileforge.sensors.picture_changes import PictureChanges

FPS = 30


def gel(number):
    """A gel lit red from the left and blue from above, with noise, and a pressing finger."""
    rows, columns = np.mgrid[:120, :160] / np.array([120, 160])[:, None, None]
    picture = np.stack(
        [60 + 120 * (1 - columns), 90 + 20 * rows * columns, 60 + 110 * (1 - rows)], -1
    )
    away = ((rows - 0.6) ** 2 + (columns - 0.4) ** 2)[..., None]
    press = 60 * abs(np.sin(number / 9)) * np.exp(-away / 0.02) * [1, -1, 0.5]
    noise = np.random.default_rng(number).normal(0, 1.5, picture.shape)
    return (picture + press + noise).clip(0, 255).astype(np.uint8)


def seen(change, start=30, count=60):
    """Time and change of every picture with one."""
    changes, found = PictureChanges(), []
    for number in range(count):
        picture = gel(number)
        if number >= start:
            picture = np.ascontiguousarray(change(picture, number - start))
        if what := changes.look(Frame(array=picture, time=number / FPS)):
            found.append((number / FPS, what))
    return found


@pytest.mark.parametrize(
    ("change", "what", "most"),
    [
        (lambda p, n: p[..., ::-1], "recoloured", 0),
        (lambda p, n: p[..., [1, 2, 0]], "recoloured", 0),
        (
            lambda p, n: np.repeat(p.mean(-1, keepdims=True).astype(np.uint8), 3, -1),
            "recoloured",
            0,
        ),
        (lambda p, n: p * np.array([0, 1, 1], np.uint8), "recoloured", 0),
        (lambda p, n: np.roll(p, 30, 0), "rolled", 0),
        (lambda p, n: np.roll(p, 70, 1), "rolled", 0),
        (lambda p, n: np.roll(p, (40, 50), (0, 1)), "rolled", 0),
        (lambda p, n: np.roll(p, 3 * n, 0), "rolled", 20),
        (lambda p, n: p[::-1, ::-1], "turned", 0),
        (lambda p, n: p[:, ::-1], "turned", 0),
    ],
)
def test_a_change_in_the_middle_is_noticed(change, what, most):
    changes = seen(change)
    assert {name for _, name in changes} == {what}
    assert 30 - most <= len(changes) <= 30
    assert 1.0 <= changes[0][0] <= 1.0 + most / FPS


@pytest.mark.parametrize(
    "change",
    [
        lambda p, n: p,
        lambda p, n: (p + 8.0).clip(0, 255).astype(np.uint8),
        lambda p, n: (p * 1.2).clip(0, 255).astype(np.uint8),
        lambda p, n: np.roll(p, 2, 1),
    ],
)
def test_touch_and_light_are_no_such_change(change):
    assert not seen(change)


def test_odd_first_pictures_are_not_what_others_are_compared_with():
    changes = PictureChanges()
    for number in range(60):
        picture = gel(number) * np.array([number > 5, 1, number > 5], np.uint8)
        assert not changes.look(Frame(array=picture, time=number / FPS))


def test_one_picture_that_is_rolled_is_one():
    assert seen(lambda p, n: np.roll(p, 40, 0) if n == 5 else p) == [(35 / FPS, "rolled")]
