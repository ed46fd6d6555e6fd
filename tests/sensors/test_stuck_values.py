"""Wrench sensors with one repeated value, and at rest."""

from dataclasses import replace

import numpy as np
import pytest
from waiting import wait_until

from tactileforge.checks import StreamChecks
from tactileforge.contracts import Frame
from tactileforge.sensors import stuck_values as module
from tactileforge.sensors.capture import Capture
from tactileforge.sensors.drivers.force_torque import ForceTorque
from tactileforge.sensors.stuck_values import StuckValues

SPEC = ForceTorque.spec
EMPTY = np.zeros((0, 0, 3), np.uint8)


def samples(stuck_from, seconds, rate=100, noise=0.01):
    rng = np.random.default_rng(0)
    values = rng.normal(0, noise, (round(seconds * rate), 6)).astype(np.float32)
    values[stuck_from:] = values[min(stuck_from, len(values) - 1)]
    return [Frame(array=EMPTY, time=n / rate, raw=one) for n, one in enumerate(values)]


def told(frames, spec=SPEC):
    check = StuckValues(spec)
    for frame in frames:
        check.look(frame)
    return check


def test_one_value_for_seconds_is_told():
    check = told(samples(100, 6))
    assert check.trouble().startswith("its values have not changed for 5.0 s, not even by noise")
    assert check.count == pytest.approx(200, abs=2)
    assert told(samples(0, 12)).count == pytest.approx(200, abs=2), "dead from the start"


def test_noise_and_a_short_rest_are_not():
    assert told(samples(10_000, 6)).trouble() == ""
    assert told(samples(400, 6)).trouble() == "", "for 2 s"
    assert told(samples(0, 6)).trouble() == "", "simulated sensors rest before they are loaded"
    assert told(samples(100, 6), replace(SPEC, kind="array")).count == 0, "taxels at rest repeat"


def test_a_capture_says_it_and_keeps_the_samples(scripted, monkeypatch):
    monkeypatch.setattr(module, "_AFTER", 0.05)
    still = dict.fromkeys(range(10, 100_000), lambda f: replace(f, raw=np.full(6, 2, np.float32)))
    kept, checks = [], StreamChecks("force", SPEC)
    with scripted(fps=200, kind="wrench", events=still) as sensor:
        capture = Capture("force", sensor, kept.append, checks=checks)
        capture.start()
        wait_until(lambda: "stuck_values" in checks.found)
        capture.stop()
    (finding,) = checks.findings()
    assert str(finding).startswith("force: TF605 its values have not changed for 0.")
    assert len(kept) > 15
