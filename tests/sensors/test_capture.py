"""A sensor in a thread: losses are counted, and lasting ones are an error."""

import re
import sys
import threading
from dataclasses import replace

import numpy as np
import pytest
from waiting import wait_until

from tactileforge.checks import StreamChecks
from tactileforge.contracts import Frame
from tactileforge.errors import SensorError
from tactileforge.sensors import capture as module
from tactileforge.sensors.capture import Capture
from tactileforge.sensors.opening import within


def run(sensor, until, **options):
    """Captures until a condition holds; gives the capture and its frames."""
    frames = []
    with sensor:
        capture = Capture("left", sensor, frames.append, **options)
        capture.start()
        wait_until(lambda: until(capture, frames))
        capture.stop()
    return capture, frames


def over(capture, frames):
    return capture.is_done


def test_every_frame_comes_once_in_order(scripted):
    sensor = scripted(fps=200, limit=40)
    capture, frames = run(sensor, over)
    assert [frame.time for frame in frames] == sensor.times
    assert capture.counts.frames == len(frames) == 40
    assert capture.ended
    assert capture.error is None
    assert capture.fps == pytest.approx(200, rel=1e-3)


def test_a_clock_that_goes_back_costs_those_frames_and_no_others(scripted):
    back = {
        5: lambda f: replace(f, time=f.time - 0.02),
        6: lambda f: replace(f, time=f.time - 0.02),
    }
    capture, frames = run(scripted(fps=200, limit=20, events=back), over)
    assert capture.counts.backwards == 2
    assert len(frames) == 18
    assert (np.diff([frame.time for frame in frames]) > 0).all()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            lambda f: replace(f, time=f.time + 60),
            r"left: a frame is (59|60)\.\d s ahead of the clock",
        ),
        (lambda f: replace(f, time=0.5), r"left: a frame is \d+\.\d s behind the clock"),
        (lambda f: replace(f, array=f.array[:5]), r"left: a frame of \(5, 24\) pixels"),
    ],
)
def test_frames_that_cannot_be_true_end_it(scripted, change, message):
    capture, frames = run(scripted(events={0: change}), over)
    assert frames == []
    with pytest.raises(SensorError, match=message):
        raise capture.error


@pytest.mark.slow
def test_a_picture_that_stays_for_a_second_is_dropped_and_counted(scripted):
    sensor = scripted(fps=100)
    sensor.picture = lambda number: np.full((32, 24, 3), 90 if number >= 20 else number, np.uint8)
    checks = StreamChecks("left", sensor.spec)
    capture, frames = run(sensor, lambda c, f: c.counts.frozen >= 30, checks=checks)
    assert checks.counts["frozen"] == capture.counts.frozen
    assert checks.found["frozen"].code == "TF601"
    assert len(frames) == 20 + 100
    assert capture.counts.frames == 120


def test_a_sensor_that_is_unplugged_is_opened_again(scripted, monkeypatch):
    monkeypatch.setattr(module, "_RETRY", 0.02)

    def unplug(frame):
        sensor.refuse.append(SensorError("not there yet"))
        raise SensorError("unplugged")

    sensor = scripted(fps=200, limit=40, events={10: unplug})
    capture, frames = run(sensor, over)
    assert sensor.opened == 2
    assert capture.counts.reopened == 1
    assert len(frames) == 39
    assert not capture.is_lost
    assert capture.error is None


def test_a_sensor_that_does_not_come_back_is_an_error(scripted, monkeypatch):
    monkeypatch.setattr(module, "_RETRY", 0.02)
    sensor = scripted(events={3: SensorError("ttyUSB0: unplugged")})
    sensor.open()
    sensor.refuse.extend([SensorError("no")] * 1000)
    capture = Capture("left", sensor, lambda frame: None, reconnect=0.1)
    capture.start()
    wait_until(lambda: capture.error)
    capture.stop()
    text = "left: ttyUSB0: unplugged (it has not come back within 0.1 s)"
    assert str(capture.error) == text


@pytest.mark.slow
def test_silence_counts_as_lost(scripted, monkeypatch):
    monkeypatch.setattr(module, "_RETRY", 0.01)
    silent = {number: TimeoutError("no frame") for number in range(5, 30)}
    sensor = scripted(fps=50, limit=60, events=silent)
    capture, frames = run(sensor, over, silence=0.2)
    assert capture.counts.reopened >= 1
    assert len(frames) == 60 - 25
    assert capture.error is None


def test_a_driver_that_raises_anything_ends_with_a_named_error(scripted):
    capture, _ = run(scripted(events={2: ZeroDivisionError("oops")}), over)
    assert str(capture.error) == "left: its driver fails with ZeroDivisionError: oops"
    assert isinstance(capture.error.__cause__, ZeroDivisionError)


def watched(sensor, until, **options):
    """A capture watched by another thread, as in recording and the live view."""
    sensor.open()
    capture = Capture("left", sensor, lambda frame: None, **options)
    capture.start()
    wait_until(lambda: until(capture) or capture.watch(), what="it is not noticed")
    return capture


def test_a_driver_that_blocks_is_noticed_from_outside(scripted):
    release = threading.Event()
    sensor = scripted(fps=200, events={20: lambda frame: release.wait(60) and frame})
    capture = watched(sensor, lambda c: c.error, silence=0.2, reconnect=0.2)
    assert re.fullmatch(
        r"left: read\(\) of its driver has not returned for \d+\.\d s; it is left behind: plug "
        r"the device out and in",
        str(capture.error),
    )
    assert capture.is_lost
    assert (capture.counts.stalled, capture.fps) == (1, 0.0)
    release.set()
    capture.stop()


def test_a_driver_that_blocks_for_a_while_comes_back(scripted):
    release = threading.Event()
    sensor = scripted(fps=200, limit=60, events={20: lambda frame: release.wait(60) and frame})
    capture = watched(sensor, lambda c: c.is_lost, silence=0.5)
    release.set()
    wait_until(lambda: capture.is_done)
    capture.stop()
    assert (capture.counts.stalled, capture.is_lost, capture.error) == (1, False, None)
    assert capture.counts.frames == 60


@pytest.mark.parametrize("leave", [SystemExit(0), KeyboardInterrupt(), GeneratorExit()])
def test_a_driver_that_exits_ends_with_a_named_error(scripted, leave):
    def go(frame):
        raise leave

    capture = watched(scripted(fps=200, events={3: go}), lambda c: c.error)
    assert str(capture.error).startswith(f"left: its driver fails with {type(leave).__name__}")


@pytest.mark.parametrize(
    ("time_of", "reason"),
    [
        (lambda now: float("nan"), "untimed"),
        (lambda now: float("inf"), "untimed"),
        (lambda now: now - 5.0, "backwards"),
    ],
)
def test_times_that_cannot_be_true_are_counted_and_end_it(scripted, monkeypatch, time_of, reason):
    monkeypatch.setattr(module, "_RETRY", 0.02)
    bad = {n: lambda f: replace(f, time=time_of(f.time)) for n in range(10, 1000)}
    sensor = scripted(fps=100, events=bad)
    capture = watched(sensor, lambda c: c.error, silence=0.15, reconnect=0.3)
    assert re.match(r"left: its times do not go on \(for \d+\.\d s\)", str(capture.error))
    assert capture.counts.frames == 10
    assert capture.drops()[reason] == sensor.count - 10 > 5
    assert capture.counts.reopened >= 1


class StillClock:
    """The clock of captures; it passes only on request."""

    seconds = 100.0

    def start(self):
        pass

    def now(self):
        return self.seconds

    def since(self, moment):
        return self.seconds - moment


def test_a_rate_sinks_while_nothing_comes(scripted, monkeypatch):
    clock = StillClock()
    monkeypatch.setattr(module, "AWAKE_CLOCK", clock)
    sensor = scripted(fps=100)
    capture = Capture("left", sensor, lambda frame: None)
    for number in range(30):
        clock.seconds += 0.01
        capture._take(Frame(array=sensor.picture(number), time=clock.seconds))
    assert capture.fps == pytest.approx(100)
    clock.seconds += 0.29
    assert capture.fps == pytest.approx(50)


def test_calls_that_hang_or_exit_are_left_behind():
    release = threading.Event()
    with pytest.raises(SensorError, match=r"a: open\(\) of its driver has not returned"):
        within(0.1, "a: open()", lambda: release.wait(60))
    release.set()
    with pytest.raises(SensorError, match=r"a: open\(\) of its driver ends with SystemExit"):
        within(1, "a: open()", lambda: sys.exit(0))
    with pytest.raises(ZeroDivisionError):
        within(1, "a: open()", lambda: 1 / 0)
    within(1, "a: open()", lambda: None)


def test_a_sensor_that_opens_and_gives_nothing_is_given_up(scripted, monkeypatch):
    monkeypatch.setattr(module, "_RETRY", 0.02)
    broken = {number: SensorError("ends at once") for number in range(3, 1000)}
    capture, frames = run(scripted(fps=200, events=broken), over, reconnect=0.2)
    assert len(frames) == 3
    assert capture.counts.reopened > 1
    assert str(capture.error) == "left: ends at once (it has not come back within 0.2 s)"


def test_a_sensor_that_was_lost_is_reopened_where_it_can_be(scripted, monkeypatch):
    monkeypatch.setattr(module, "_RETRY", 0.02)
    sensor = scripted(fps=200, limit=20, events={5: SensorError("unplugged")})
    calls = []
    sensor.reopen = lambda: calls.append("reopen") or type(sensor).open(sensor)
    _, frames = run(sensor, over)
    assert calls == ["reopen"]
    assert len(frames) == 19
