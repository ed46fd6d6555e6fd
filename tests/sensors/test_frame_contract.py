"""Forbidden frames of drivers, at the one door for all frames."""

from dataclasses import replace

import numpy as np
import pytest
from waiting import wait_until

from tactileforge.contracts import Frame
from tactileforge.errors import SensorError
from tactileforge.sensors import capture as module
from tactileforge.sensors.capture import Capture
from tactileforge.sensors.frame_contract import bad_values, check_frame
from tactileforge.specs.published import SPECS

DIGIT = replace(SPECS["digit"], height=8, width=6)
PICTURE = np.full((8, 6, 3), 100, np.uint8)


@pytest.mark.parametrize(
    ("array", "message"),
    [
        (PICTURE[..., 0], "a frame of 1 channel, and frames are RGB: .* in colour"),
        (PICTURE[..., :1], "a frame of 1 channel, and"),
        (np.full((8, 6, 4), 9, np.uint8), "a frame of 4 channels, .* leave out the fourth"),
        (PICTURE / np.float32(255), "a frame of float32, and frames are uint8, 0 to 255: .* scale"),
        (np.full((8, 6, 3), np.nan, np.float32), "a frame of float32"),
        (PICTURE.astype(np.uint16), "a frame of uint16, .* convert"),
        (PICTURE[:4], r"a frame of \(4, 6\) pixels, and its spec says \(8, 6\)"),
        (PICTURE.tolist(), "a frame is a list"),
        (None, "a frame is a NoneType"),
    ],
)
def test_another_picture_than_the_spec_says_is_named(array, message):
    with pytest.raises(SensorError, match=message):
        check_frame(Frame(array=array, time=0.0), DIGIT)


@pytest.mark.parametrize("name", list(SPECS))
def test_a_sensor_that_lies_on_its_side_is_named(name):
    upright = SPECS[name]
    check_frame(
        Frame(array=np.zeros((upright.height, upright.width, 3), np.uint8), time=0), upright
    )
    lying = replace(upright, height=upright.width, width=upright.height)
    with pytest.raises(SensorError, match=f"lie on their side: those of a {name} .*rotation=90"):
        check_frame(Frame(array=np.zeros((lying.height, lying.width, 3), np.uint8), time=0), lying)
    square = replace(upright, height=64, width=64)
    check_frame(Frame(array=np.zeros((64, 64, 3), np.uint8), time=0), square)


def sample(kind, raw, **more):
    picture = PICTURE if kind == "array" else np.zeros((0, 0, 3), np.uint8)
    height, width = picture.shape[:2]
    spec = replace(DIGIT, name="x", kind=kind, height=height, width=width, **more)
    return Frame(array=picture, time=0.0, raw=raw), spec


def wrench(last):
    return np.array([0, 0, 1, 0, 0, last], np.float32)


@pytest.mark.parametrize(
    ("kind", "raw", "reason"),
    [
        ("wrench", wrench(0), ""),
        ("wrench", wrench(np.nan), "no_number"),
        ("wrench", wrench(-np.inf), "no_number"),
        ("wrench", None, "no_number"),
        ("wrench", 1e30 * wrench(0), "implausible"),
        ("wrench", 20_000 * wrench(0), "implausible"),
        ("array", np.full((4, 3), np.nan, np.float32), "no_number"),
        ("array", np.full((4, 3), 1e30, np.float32), "implausible"),
        ("array", np.full((4, 3), 65535, np.float32), ""),
        ("robot", np.array([0.1, np.nan], np.float32), "no_number"),
        ("robot", np.array([0.1, 0.2], np.float32), ""),
    ],
)
def test_values_that_cannot_be_have_a_reason(kind, raw, reason):
    frame, spec = sample(kind, raw, states=1, actions=1)
    check_frame(frame, spec)
    assert bad_values(frame, spec) == reason


@pytest.mark.parametrize(
    ("kind", "shape"), [("wrench", (3,)), ("wrench", (1, 6)), ("robot", (3,)), ("array", (12,))]
)
def test_values_of_another_shape_are_named(kind, shape):
    frame, spec = sample(kind, np.zeros(shape, np.float32), states=1, actions=1)
    with pytest.raises(SensorError, match=f"and those of a {kind} are"):
        check_frame(frame, spec)


@pytest.mark.parametrize("value", [np.nan, np.inf, None, 1e30])
def test_a_wrench_sensor_that_dies_is_counted_lost_and_an_error(scripted, monkeypatch, value):
    monkeypatch.setattr(module, "_RETRY", 0.01)

    def die(frame):
        return replace(frame, raw=None if value is None else np.full(6, value, np.float32))

    sensor = scripted(fps=200, kind="wrench", events=dict.fromkeys(range(10, 100_000), die))
    good = []
    with sensor:
        capture = Capture("force", sensor, good.append, reconnect=0.2, silence=0.2)
        capture.start()
        wait_until(lambda: capture.error)
        capture.stop()
    reason = "implausible" if value == 1e30 else "no_number"
    assert len(good) == 10
    assert capture.drops()[reason] == sensor.count - 10
    assert capture.is_lost
    assert str(capture.error).startswith("force: its values are ")


def test_reasons_of_the_driver_and_of_the_door_add_up(scripted):
    sensor = scripted(kind="wrench")
    sensor.drops = {"implausible": 3, "jumped": 0}
    capture = Capture("force", sensor, lambda frame: None)
    capture._take(Frame(array=PICTURE, time=sensor_time(), raw=np.full(6, 1e30, np.float32)))
    assert capture.drops() == {
        "backwards": 0, "untimed": 0, "frozen": 0, "implausible": 4, "jumped": 0,
    }  # fmt: skip


def sensor_time():
    import time

    return time.monotonic()
