"""Checks of a running sensor, as `record` and `live` run them."""

from dataclasses import replace
from typing import ClassVar

import numpy as np
import pytest

from tactileforge.checks import Check, StreamChecks, stream
from tactileforge.contracts import Frame
from tactileforge.errors import ConfigError
from tactileforge.specs import spec

FPS = 30


def shown(checks, pictures, times=None):
    """The pictures handed on; each arrives at its own moment."""
    times = np.arange(len(pictures)) / FPS if times is None else times
    rows = zip(pictures, times, strict=True)
    return [
        checks.look(Frame(array=picture, time=float(time)), i / FPS)
        for i, (picture, time) in enumerate(rows)
    ]


def pictures(count):
    rng = np.random.default_rng(0)
    return [rng.integers(60, 200, (64, 48, 3), np.uint8) for _ in range(count)]


def test_a_frozen_picture_is_dropped_and_no_other_check_sees_it():
    checks = StreamChecks("left", spec("digit"))
    black = [*pictures(5), *[np.zeros((64, 48, 3), np.uint8)] * 60]
    kept = shown(checks, black)
    assert kept == [True] * 35 + [False] * 30  # a second of it is kept
    assert checks.counts == {"black": 30, "frozen": 30}
    assert sorted(finding.code for finding in checks.findings()) == ["TF601", "TF602"]
    assert {finding.where for finding in checks.findings()} == {"left"}


def test_what_tells_of_the_stream_so_far_is_taken_back():
    """A clock seems slow in the first seconds, as frames pile up, and is right in the end."""
    checks = StreamChecks("left", spec("digit"))
    arrived = np.arange(30 * FPS) / FPS
    shown(checks, pictures(len(arrived)), np.where(arrived < 4, 0.8 * arrived, arrived))
    assert "clock_of_stream" not in checks.found
    early = StreamChecks("left", spec("digit"))
    shown(early, pictures(4 * FPS), 0.8 * arrived[: 4 * FPS])
    assert early.found["clock_of_stream"].words.startswith("its clock is 20 % slow")


def test_each_kind_of_sensor_has_its_own():
    def codes(kind):
        return {c.code for c, _ in StreamChecks("a", replace(spec("digit"), kind=kind))._watches}

    assert codes("image") == {"TF601", "TF602", "TF603", "TF604"}
    assert codes("wrench") == {"TF604", "TF605"}
    assert codes("array") == codes("robot") == {"TF604"}


def test_checks_are_left_out_by_code():
    checks = StreamChecks("left", spec("digit"), ignore=["TF601", "exposure_of_stream"])
    assert all(shown(checks, [np.zeros((64, 48, 3), np.uint8)] * 60))
    assert not checks.findings()
    with pytest.raises(ConfigError, match="ignore: unknown check 'TF999'"):
        StreamChecks("left", spec("digit"), ignore=["TF999"])


def test_a_check_of_a_package_runs_too_and_its_fault_ends_nothing(monkeypatch):
    class Bright(Check):
        code, level, needs, fix = "LAB601", "warning", frozenset({"stream"}), "dim it"
        troubles: ClassVar = {"bright": "too bright: dim it"}

        def watch(self, spec):
            return lambda frame, arrived: "bright" if frame.array.mean() > 120 else ""

    class Broken(Bright):
        code, name = "LAB602", "broken"

        def watch(self, spec):
            return lambda frame, arrived: 1 / 0

    monkeypatch.setattr(stream, "chosen", lambda ignore: [Bright, Broken])
    checks = StreamChecks("left", spec("digit"))
    assert all(shown(checks, pictures(9)))
    assert checks.counts["bright"] == 9
    assert str(checks.found["bright"]) == "left: LAB601 too bright: dim it"
    assert "ZeroDivisionError" in checks.found["broken"].words
