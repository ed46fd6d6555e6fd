"""The camera against LeRobot's own base classes, with simulated sensors."""

import threading
import time

import numpy as np
import pytest

pytest.importorskip("lerobot.cameras", reason="LeRobot is not installed")

import draccus
from lerobot.cameras import Camera, CameraConfig, make_cameras_from_configs
from lerobot.utils.errors import DeviceAlreadyConnectedError, DeviceNotConnectedError
from lerobot_camera_tactileforge import TactileForgeCamera, TactileForgeCameraConfig

from tactileforge.contracts import Frame
from tactileforge.errors import ConfigError, PluginError, SensorError
from tactileforge.sensors import opening
from tactileforge.specs.published import spec

SIM = {"type": "digit", "size": 32}


def config(**options):
    return TactileForgeCameraConfig(sensor="sim", options={**SIM, **options})


@pytest.fixture
def camera():
    made = TactileForgeCamera(config())
    made.connect()
    yield made
    if made.is_connected:
        made.disconnect()


def test_lerobot_builds_it_from_words():
    """Parses a configuration like ``--robot.cameras={left: {type: tactileforge, ...}}``."""
    words = {"type": "tactileforge", "sensor": "sim", "options": SIM}
    parsed = draccus.decode(CameraConfig, words)
    assert isinstance(parsed, TactileForgeCameraConfig)
    assert (parsed.type, parsed.height, parsed.width) == ("tactileforge", 43, 32)
    assert parsed.fps == round(spec("digit").fps)
    (made,) = make_cameras_from_configs({"left": parsed}).values()
    assert isinstance(made, TactileForgeCamera)
    assert isinstance(made, Camera)
    assert not made.is_connected


def test_frames_are_those_of_the_sensor(camera):
    frame = camera.read()
    assert (frame.shape, frame.dtype) == ((43, 32, 3), np.uint8)
    assert frame.std() > 5
    with TactileForgeCamera(TactileForgeCameraConfig(**vars(config()))) as same:
        assert same.is_connected
    assert not same.is_connected


def test_a_frame_is_given_once_and_peeked_often(camera):
    first = camera.async_read(2000)
    np.testing.assert_array_equal(camera.read_latest(5000), camera.read_latest(5000))
    later = camera.async_read(2000)
    assert not np.array_equal(first, later)
    with pytest.raises(TimeoutError, match="no new frame within 0 ms"):
        [camera.async_read(0) for _ in range(50)]


def test_frames_are_resized_to_what_was_asked_for():
    made = TactileForgeCamera(
        TactileForgeCameraConfig(sensor="sim", options=SIM, width=48, height=20, fps=10)
    )
    assert (made.fps, made.width, made.height) == (10, 48, 20)
    with made:
        assert made.read().shape == (20, 48, 3)


def test_it_is_opened_and_closed_once(camera):
    with pytest.raises(DeviceAlreadyConnectedError, match="connected already"):
        camera.connect()
    camera.disconnect()
    for call in (camera.disconnect, camera.read, camera.async_read, camera.read_latest):
        with pytest.raises(DeviceNotConnectedError, match="not connected"):
            call()
    camera.connect(warmup=False)
    assert camera.read().shape == (43, 32, 3)


def test_attached_sensors_are_found():
    found = TactileForgeCamera.find_cameras()
    (sim,) = [one for one in found if one["sensor"] == "sim"]
    assert sim["type"] == "tactileforge"
    assert sim["id"].startswith("sim:")
    assert sim["default_stream_profile"]["height"] == 240
    assert not [one for one in found if one["sensor"] in ("sim_wrench", "force_torque")]


class Broken:
    """A sensor with two frames, then lost."""

    spec = config().build().spec

    def __init__(self, frames=2):
        self.left = frames

    def open(self):
        if self.left == 0:
            raise SensorError("unplugged")

    def read(self, timeout=1.0):
        time.sleep(0.02)
        if self.left == 0:
            raise SensorError("unplugged")
        self.left -= 1
        return Frame(array=np.full((43, 32, 3), self.left, np.uint8), time=time.monotonic())

    def close(self):
        pass


def test_a_sensor_that_is_gone_is_named(monkeypatch):
    made = TactileForgeCamera(TactileForgeCameraConfig(sensor="sim", options=SIM, reconnect=0.1))
    monkeypatch.setattr(TactileForgeCameraConfig, "build", lambda self: Broken())
    made.connect()
    made.read()
    with pytest.raises(ConnectionError, match=r"sim.*unplugged"):
        made.read()
    with pytest.raises(TimeoutError, match="ms old"):
        made.read_latest(0)
    made.disconnect()
    monkeypatch.setattr(TactileForgeCameraConfig, "build", lambda self: Broken(0))
    with pytest.raises(ConnectionError, match="cannot be opened: unplugged"):
        made.connect()
    assert not made.is_connected


def test_what_cannot_be_a_camera_is_named():
    with pytest.raises(PluginError, match="did you mean"):
        TactileForgeCameraConfig(sensor="simm")
    with pytest.raises(ValueError, match=r"wrench.* gives no pictures"):
        TactileForgeCameraConfig(sensor="sim_wrench")
    with pytest.raises(ValueError, match="give 1 or more"):
        TactileForgeCameraConfig(sensor="sim", width=0)


def test_drivers_that_hang_or_fail_are_connection_errors(monkeypatch):
    release = threading.Event()
    monkeypatch.setattr(opening, "_OPEN", 0.2)
    monkeypatch.setattr(opening, "_CLOSE", 0.2)
    made = TactileForgeCamera(config())
    broken = Broken()
    monkeypatch.setattr(TactileForgeCameraConfig, "build", lambda self: broken)
    broken.open = lambda: release.wait(60)
    with pytest.raises(ConnectionError, match=r"open\(\) of its driver has not returned"):
        made.connect()
    for error in (RuntimeError("no SDK"), ValueError("x"), ConfigError("no port")):

        def fail(error=error):
            raise error

        broken.open = fail
        with pytest.raises(ConnectionError, match="cannot be opened: "):
            made.connect()
        assert not made.is_connected
    broken.open = lambda: None
    made.connect()
    broken.close = lambda: release.wait(60)
    with pytest.raises(ConnectionError, match=r"cannot be closed: .*has not returned"):
        made.disconnect()
    assert not made.is_connected
    release.set()
