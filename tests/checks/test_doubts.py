"""Doubts about labels without pixels, once for each kind."""

import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from tactileforge_inspect.reasons import REASONS

from tactileforge.checks.doubts import FIXES, Doubts, check_labels
from tactileforge.contracts import Recording
from tactileforge.data.frames.lazy import ArrayFrames


def touch(number: int = 0, size: int = 16, count: int = 20, **fields: Any) -> Recording:
    given = {
        "key": f"a/{number}",
        "sensor": "digit",
        "frames": ArrayFrames(np.zeros((count, size, size, 3), np.uint8)),
        "times": np.arange(count) / 30,
        "no_contact": None,
        "object": f"thing {number}",
    }
    return Recording(**(given | fields))


def pressed(newton: float, axis: int = 2) -> np.ndarray[Any, Any]:
    force = np.zeros((20, 3), np.float32)
    force[:, axis] = np.linspace(0, newton, 20)
    return force


def said(*recordings: Recording) -> list[str]:
    doubts = Doubts()
    for recording in recordings:
        doubts.add(recording)
    lines = [*doubts.of_each(), *doubts.of_all()]
    assert all(re.match(r"TF\d{3} ", line) for line in lines), "each with its code"
    return [line[6:] for line in lines]


def test_sane_recordings_raise_no_doubt() -> None:
    assert said(touch(0, force=pressed(5.0)), touch(1, force=pressed(14.0))) == []
    assert said(touch(0)) == [], "one recording has one object"
    assert said(touch(0, force=np.zeros((20, 3))), touch(1, force=pressed(3))) == []


@pytest.mark.parametrize("factor", [102.0, 1000.0, -102.0])
def test_grams_millinewton_and_signs(factor: float) -> None:
    lines = said(touch(0, force=pressed(8 * factor)), touch(1, force=pressed(2 * factor)))
    assert lines[0].startswith("force out of range in 2 of 2 recordings (a/0: ")
    assert "is it grams or mN? unit: of force in a layout" in lines[0]
    pulls = [line for line in lines if line.startswith("pulling force in 2 of 2 recordings (a/0")]
    assert len(pulls) == (factor < 0)
    assert len(lines) == 1 + len(pulls), "each is said once"


def test_forces_of_kilonewton() -> None:
    (line,) = said(touch(0, force=pressed(0.0075)), touch(1, force=pressed(0.002)))
    assert line.startswith("the largest force is 0.0075 N, less than a hundredth of the scale")
    assert said(touch(0, force=pressed(0.0075)), touch(1, force=pressed(1))) == []


def test_a_force_that_stops() -> None:
    noise = np.random.default_rng(0).normal(1, 0.1, (60, 3)).astype(np.float32)
    stuck = noise.copy()
    stuck[20:] = noise[20]
    lines = said(touch(0, count=60, force=noise), touch(1, count=60, force=stuck))
    assert [line[:58] for line in lines] == [
        "stuck force in 1 of 2 recordings (a/1: 1.3 s of one and th"
    ]
    stuck[20:] = 0
    assert said(touch(0, count=60, force=stuck), touch(1, count=60)) == [], "lifted"


def test_objects_spelled_in_two_ways() -> None:
    lines = said(
        touch(0, object="Small bolt"), touch(1, object="nut"), touch(2, object="small_bolt")
    )
    assert lines == [
        "objects 'Small bolt' and 'small_bolt' differ only in their spelling, and count as two: "
        "spell them alike, if they are one"
    ]


@pytest.mark.parametrize(("value", "words"), [(0.0, "all 0 N"), (2.5, "all the same (2.5, 2.5, ")])
def test_forces_that_never_change(value: float, words: str) -> None:
    force = np.full((20, 3), value, np.float32)
    (line,) = said(touch(0, force=force), touch(1, force=force))
    assert line.startswith(f"the forces of all 40 frames are {words}")
    normal = force.copy()
    normal[:, :2] = np.nan
    assert len(said(touch(0, force=normal))) == 1, "also of an axis alone"


def test_one_class_alone() -> None:
    press = np.full(20, 1, np.int64)
    same = [touch(i, object="cup", action=press) for i in range(2)]
    objects, actions = said(*same)
    assert objects.startswith("only one object (cup) in 2 recordings: nothing that tells")
    assert actions.startswith("only one action (")
    assert said(same[0], touch(1, action=np.full(20, 2))) == []
    doubts = Doubts()
    for one in same:
        doubts.add(one)
    assert doubts.of_all({"action"}) == [f"TF402 {actions}"], "of what is learnt alone"


def test_pictures_without_a_shape() -> None:
    (line,) = said(touch(size=1))
    assert line.startswith("tiny pictures in 1 of 1 recordings (a/0: 1 x 1 pixels)")
    assert said(touch(size=8)) == []


def test_views_of_another_time() -> None:
    views = ArrayFrames(np.zeros((3, 16, 16, 3), np.uint8))
    one = touch(image=views, image_times=np.array([0.1, 0.2, 0.4]))
    assert said(one) == []
    (line,) = said(replace(one, image_times=np.arange(3) + 1.7e9))
    assert line.startswith("views elsewhere in 1 of 1 recordings")


def test_every_reason_is_explained() -> None:
    assert set(FIXES) <= set(REASONS)
    assert {flag.reason for flag in check_labels(touch(size=1))} <= set(REASONS)


def test_axes_in_another_order() -> None:
    wave = np.sin(np.linspace(0, 9, 20))
    force = np.stack([0.3 * wave, 0.2 * wave, np.linspace(0.1, 6, 20)], axis=1)
    assert said(touch(0, force=force)) == []
    (line,) = said(touch(0, force=force), touch(1, force=force[:, [2, 1, 0]]))
    assert line.startswith("axes exchanged in 1 of 2 recordings (a/1: largest along x, with one")
    stills = [touch(k, count=1, force=force[k : k + 1, [0, 2, 1]]) for k in range(20)]
    (line,) = said(*stills)
    assert line.startswith("forces of all recordings are largest along y, with one sign; in contac")
