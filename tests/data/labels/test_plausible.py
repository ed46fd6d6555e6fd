"""Impossible numbers are named by recording and row."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from tactileforge.contracts import Recording
from tactileforge.data.frames.lazy import ArrayFrames
from tactileforge.data.labels.plausible import impossible, limits

TOUCH = Recording(
    key="a/b",
    sensor="digit",
    frames=ArrayFrames(np.zeros((4, 8, 8, 3), np.uint8)),
    times=np.arange(4.0),
    no_contact=None,
)


def forces(value: float, row: int = 2, axis: int = 1) -> np.ndarray[Any, Any]:
    force = np.zeros((4, 3))
    force[row, axis] = value
    return force


@pytest.mark.parametrize("axis", range(3))
def test_forces_beyond_a_hundred_times_the_scale(axis: int) -> None:
    most = limits("digit")[axis]
    assert most == pytest.approx(100 * (5.25, 10.61, 14.14)[axis])
    for sign in (1, -1):
        good = replace(TOUCH, force=forces(sign * most, axis=axis).astype(np.float32))
        assert impossible(good) == ""
        bad = replace(TOUCH, force=forces(sign * most * 1.001, axis=axis).astype(np.float32))
        assert impossible(bad).startswith("a/b, row 2: a force of (")


@pytest.mark.parametrize("value", [1e39, float("inf"), -1e39])
def test_numbers_beyond_float32(value: float) -> None:
    with np.errstate(over="ignore"):
        force = forces(value).astype(np.float32)  # as a reader makes it of 1e39: inf
        track = forces(value, row=3).astype(np.float32)
    assert impossible(replace(TOUCH, force=force)).startswith("a/b, row 2: a force of (")
    for values in (track, forces(value, row=3), forces(value, row=3)[:, 1]):
        said = impossible(replace(TOUCH, tracks={"wrench": values}))
        assert said.startswith("a/b, row 3: wrench is ")
    said = impossible(replace(TOUCH, labels={"name": "1e39", "hardness": value}))
    assert said.startswith("a/b: hardness is ")


def test_what_is_unknown_or_large_is_no_slip() -> None:
    tracks = {"wrench": np.full((4, 6), np.nan, np.float32), "image": np.full(4, 2**60)}
    labels = {"clock": 1e12, "text": "inf", "missing": float("nan")}
    force = np.full((4, 3), np.nan, np.float32)
    assert impossible(replace(TOUCH, force=force, tracks=tracks, labels=labels)) == ""
