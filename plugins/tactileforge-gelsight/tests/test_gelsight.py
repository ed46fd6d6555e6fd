from pathlib import Path

import cv2
import numpy as np
import pytest
from tactileforge_gelsight.sensor import GelSightMini, GelSightMiniMarkers

from tactileforge.errors import ConfigError, SensorError
from tactileforge.sensors.drivers import camera, v4l2
from tactileforge.testing import check
from tactileforge.testing.clock import FakeTime


@pytest.fixture
def clock(monkeypatch):
    """A simulated clock for cameras and the test; it advances on sleep alone."""
    made = FakeTime()
    monkeypatch.setattr(camera, "time", made)
    return made


@pytest.fixture
def system(tmp_path, monkeypatch):
    """Two Minis and another camera of the same USB id; one Mini has a node for metadata."""
    folder = tmp_path / "video4linux"
    names = {
        0: ("Arducam USB Camera", 0),
        4: ("GelSight Mini R0B 2BKR-9FKA: Ge", 0),
        5: ("GelSight Mini R0B 2BKR-9FKA: Ge", 1),
        6: ("GelSight Mini R0B 28CZ-3YA2: Ge", 0),
    }
    for number, (name, index) in names.items():
        node = folder / f"video{number}"
        node.mkdir(parents=True)
        (node / "name").write_text(f"{name}\n")
        (node / "index").write_text(f"{index}\n")
    monkeypatch.setattr(v4l2, "SYSTEM", folder)
    return folder


class Device:
    """OpenCV's capture of a Mini: it accepts every setting, and has one mode.

    Args:
        period: Time between frames, s.
        dark: Number of black frames at the start.
    """

    def __init__(self, clock, period, dark=0, size=(3280, 2464)):
        self.clock = clock
        self.period, self.dark, self.size = period, dark, size
        self.asked, self.count = [], 0
        self.due = clock.monotonic()

    def isOpened(self):
        return True

    def set(self, control, value):
        self.asked.append((control, value))
        return True

    def get(self, control):
        width, height = self.size
        known = {cv2.CAP_PROP_FRAME_WIDTH: width, cv2.CAP_PROP_FRAME_HEIGHT: height}
        known |= {cv2.CAP_PROP_FPS: 25.0, cv2.CAP_PROP_POS_MSEC: 1000 * self.due}
        return float(known.get(control, 0.0))

    def grab(self):
        self.due += self.period
        self.clock.sleep(self.due - self.clock.monotonic())
        self.count += 1
        return True

    def retrieve(self):
        width, height = self.size
        value = 0 if self.count <= self.dark else 100
        return True, np.full((height, width, 3), value, np.uint8)

    def release(self):
        pass


def test_units_are_found_by_name(system):
    assert GelSightMini().discover() == ["/dev/video4", "/dev/video6"]
    assert GelSightMini(unit="28CZ-3YA2").discover() == ["/dev/video6"]
    with pytest.raises(SensorError, match="fits /dev/video4, /dev/video6"):
        GelSightMini().open()


def test_the_rate_that_comes_is_measured_on_frames_that_are_thrown_away(system, monkeypatch, clock):
    made = Device(clock, 1 / 18.75, dark=10, size=(328, 246))
    monkeypatch.setattr(camera, "open_capture", lambda source, backend: made)
    monkeypatch.setattr(camera.Path, "exists", lambda path: True)
    with GelSightMini(unit="28CZ-3YA2", width=328, height=246) as sensor:
        assert (sensor.address, sensor.unit) == ("/dev/video6", "28CZ-3YA2")
        assert sensor.spec.fps == pytest.approx(18.75)  # 25 is promised
        assert sensor.read().array.min() == 100
    assert made.count == 21
    assert (cv2.CAP_PROP_FOURCC, cv2.VideoWriter.fourcc(*"MJPG")) in made.asked


def test_another_mode_is_refused(system, monkeypatch, clock):
    made = Device(clock, 0.0, size=(640, 480))
    monkeypatch.setattr(camera, "open_capture", lambda source, backend: made)
    with pytest.raises(SensorError, match="width=3280 was asked for, and it gives 640"):
        GelSightMini(unit="28CZ-3YA2").open()


def test_the_crop_is_a_seventh_at_each_side():
    """The crop of 2464 x 3280 pixels is rows 352 to 2111 and columns 468 to 2811."""
    sensor = GelSightMini()
    frame = np.full((2464, 3280, 3), 255, np.uint8)
    frame[352:2112, 468:2812] = 90
    seen = sensor.prepare(frame)
    assert seen.shape == (240, 320, 3)
    assert (seen == 90).all()
    frame[:353] = 255
    assert (sensor.prepare(frame)[0] > 90).all()


@pytest.mark.parametrize(("kind", "markers"), [(GelSightMini, False), (GelSightMiniMarkers, True)])
def test_both_gels(kind, markers):
    spec = kind().spec
    assert (spec.markers, spec.height, spec.width) == (markers, 240, 320)
    assert spec.name == ("gelsight_mini_markers" if markers else "gelsight_mini")


def test_options_that_cannot_be():
    with pytest.raises(ConfigError, match="warmup=1"):
        GelSightMini(warmup=1)


def write(path, frames, size, fps):
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), fps, size)
    for frame in frames:
        writer.write(frame)
    writer.release()
    return str(path)


@pytest.fixture
def video(tmp_path):
    frames = [np.full((246, 328, 3), 3 * i, np.uint8) for i in range(80)]
    return {
        "device": write(tmp_path / "mini.avi", frames, (328, 246), 25),
        "width": 328,
        "height": 246,
    }


def test_a_file_in_place_of_the_device_and_a_reader_that_is_late(video, clock):
    with GelSightMini(**video) as sensor:
        frames = [sensor.read() for _ in range(2)]
        clock.sleep(0.15)  # three frames are lost
        frames.append(sensor.read())
        assert sensor.spec.fps == 25
    numbers = [round(float(frame.array.mean()) / 3) for frame in frames]
    assert numbers[2] - numbers[1] >= 3
    times = [frame.time for frame in frames]
    assert np.diff(times) == pytest.approx(np.diff(numbers) / 25, abs=1e-6)


@pytest.mark.parametrize("name", ["gelsight_mini", "gelsight_mini_markers"])
def test_conformance_with_a_file(video, name):
    results = check("sensor", name, **video)
    statuses = {result.name: result.status for result in results}
    assert statuses.pop("discover with nothing attached gives nothing") == "skipped"
    assert set(statuses.values()) == {"ran"}, results


def test_conformance_with_nothing_attached(tmp_path, monkeypatch):
    monkeypatch.setattr(v4l2, "SYSTEM", Path(tmp_path))
    statuses = {result.name: result.status for result in check("sensor", "gelsight_mini")}
    assert statuses["discover with nothing attached gives nothing"] == "ran"
    assert statuses["frames are as specified"] == "skipped"
    assert "failed" not in statuses.values()
