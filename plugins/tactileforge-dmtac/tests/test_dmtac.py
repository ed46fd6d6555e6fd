import sys
import time
from types import ModuleType, SimpleNamespace

import cv2
import numpy as np
import pytest
from tactileforge_dmtac.sdk import DmTacSdk
from tactileforge_dmtac.sensor import DmTac

from tactileforge.errors import ConfigError, SensorError, TactileForgeError
from tactileforge.sensors.drivers import v4l2
from tactileforge.testing import check
from tactileforge.testing.clock import FakeTime


@pytest.fixture
def video(tmp_path):
    path = tmp_path / "dmtac.avi"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 30, (64, 48))
    for i in range(80):
        writer.write(np.full((48, 64, 3), 3 * i, np.uint8))
    writer.release()
    return str(path)


def test_the_camera_is_found_by_its_name(tmp_path, monkeypatch):
    for number, name in enumerate(["Webcam", "N160MU2: N160MU2"]):
        node = tmp_path / f"video{number}"
        node.mkdir()
        (node / "name").write_text(name)
    monkeypatch.setattr(v4l2, "SYSTEM", tmp_path)
    assert DmTac().discover() == ["/dev/video1"]
    assert DmTac(serial="S1").discover() == []
    with pytest.raises(SensorError, match="no camera serial:S1 is attached"):
        DmTac(serial="S1").open()


def test_a_file_in_place_of_the_camera_and_a_reader_that_is_late(video, monkeypatch):
    clock = FakeTime()
    monkeypatch.setattr("tactileforge.sensors.drivers.camera.time", clock)
    with DmTac(device=video, crop=[8, 4, 36, 44], rotation=90, warmup=0) as sensor:
        assert (sensor.spec.name, sensor.spec.height, sensor.spec.width) == ("dm", 36, 44)
        frames = [sensor.read() for _ in range(2)]
        clock.sleep(0.12)
        frames.append(sensor.read())
    numbers = [round(float(frame.array.mean()) / 3) for frame in frames]
    assert numbers[2] - numbers[1] >= 3
    times = [frame.time for frame in frames]
    assert np.diff(times) == pytest.approx(np.diff(numbers) / 30, abs=1e-6)


def test_conformance_with_a_file(video):
    statuses = {result.name: result.status for result in check("sensor", "dmtac", device=video)}
    assert statuses.pop("discover with nothing attached gives nothing") == "skipped"
    assert set(statuses.values()) == {"ran"}


class Sensor:
    """Public interface of the vendor's software: numbered images, 100 per second."""

    opened: list = []  # noqa: RUF012
    status = 0
    silent = False

    def __init__(self, options):
        if options.dev_id == "none":
            raise RuntimeError("no such device")
        self.options, self.is_open = options, True
        self.start = time.monotonic()
        self.opened.append(self)

    def number(self):
        return int((time.monotonic() - self.start) * 100)

    def wait_for_new(self, last, timeout_ms):
        end = time.monotonic() + timeout_ms / 1000
        while self.silent or self.number() <= last:
            if time.monotonic() >= end:
                return False
            time.sleep(0.001)
        return True

    def getDevStatus(self):
        return self.status

    def getInferImg(self):
        pixels = np.zeros((288, 384, 3), np.uint8)
        pixels[:] = (10, 20, 30)  # blue, green, red
        return self.number(), SimpleNamespace(img=pixels)

    def getRawImg(self):
        return self.number(), np.full((480, 640), 7, np.uint8)

    def disconnect(self):
        self.is_open = False


@pytest.fixture
def sdk(monkeypatch):
    module = ModuleType("dmrobotics")
    module.Sensor = type("Sensor", (Sensor,), {"opened": []})
    module.SensorOptions = SimpleNamespace
    monkeypatch.setitem(sys.modules, "dmrobotics", module)
    return module.Sensor


def test_pictures_of_the_vendors_software(sdk):
    with DmTacSdk(serial="M2505150275", backend="cuda") as sensor:
        frame = sensor.read()
        assert frame.array.shape == (288, 384, 3)
        assert frame.array[0, 0].tolist() == [30, 20, 10]
        assert sensor.read().time > frame.time
        assert sensor.address == "dmrobotics:M2505150275"
    [opened] = sdk.opened
    assert not opened.is_open
    options = vars(opened.options)
    assert (options["dev_id"], options["backend"]) == ("M2505150275", "cuda")
    assert "remote_addr" not in options


def test_the_picture_of_the_camera_on_the_network(sdk):
    with DmTacSdk(picture="raw", remote="192.168.127.10:50051") as sensor:
        assert (sensor.spec.height, sensor.spec.width) == (480, 640)
        assert sensor.read().array[0, 0].tolist() == [7, 7, 7]
    options = sdk.opened[0].options
    assert (options.dev_id, options.remote_addr) == (0, "192.168.127.10:50051")
    assert options.enable_raw


def test_a_picture_comes_once(sdk):
    with DmTacSdk() as sensor:
        device, numbers = sdk.opened[0], []
        image = device.getInferImg
        device.getInferImg = lambda: numbers.append(device.number()) or image()
        for _ in range(11):
            sensor.read()
    assert len(numbers) == 10, "the first came when it was opened"
    assert numbers == sorted(set(numbers))


def test_troubles_of_the_device(sdk):
    with pytest.raises(SensorError, match=r"DM-Tac none: cannot be opened \(no such device\)"):
        DmTacSdk(serial="none").open()
    with DmTacSdk() as sensor:
        sensor.read()
        sdk.silent = True
        with pytest.raises(TimeoutError, match=r"no picture within 0\.05 s"):
            sensor.read(0.05)
        sdk.status = 3
        with pytest.raises(SensorError, match="status 3"):
            sensor.read()
        with pytest.raises(SensorError, match="status 3"):
            sensor.open()
        assert not any(one.is_open for one in sdk.opened)
        sdk.silent, sdk.status = False, 0
        sensor.open()
        assert sensor.read().array.shape == (288, 384, 3)


def test_conformance_with_the_vendors_software(sdk):
    assert {result.status for result in check("sensor", "dmtac_sdk")} == {"ran"}


def test_without_the_vendors_software(monkeypatch):
    monkeypatch.setitem(sys.modules, "dmrobotics", None)
    with pytest.raises(SensorError, match="pip install dmrobotics"):
        DmTacSdk().open()
    with pytest.raises(TactileForgeError, match="not open"):
        DmTacSdk().read()
    statuses = {result.name: result.status for result in check("sensor", "dmtac_sdk")}
    assert statuses["frames are as specified"] == "skipped"
    assert "failed" not in statuses.values()


def test_options_that_cannot_be():
    with pytest.raises(ConfigError, match="give raw or infer"):
        DmTacSdk(picture="depth")
