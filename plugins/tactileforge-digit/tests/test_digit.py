import cv2
import numpy as np
import pytest
from tactileforge_digit.attached import Unit, attached
from tactileforge_digit.sensor import Digit, packed

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


def plug(system, number, *, serial, usb="2833:0209", bcd="0200", index=0):
    """A camera as Linux lists it; one with two nodes has the same USB device behind both."""
    usb_device = system.parent / "usb" / serial
    (usb_device / "interface").mkdir(parents=True, exist_ok=True)
    vendor, product = usb.split(":")
    texts = {"idVendor": vendor, "idProduct": product, "serial": serial, "bcdDevice": bcd}
    for name, text in texts.items():
        (usb_device / name).write_text(f"{text}\n")
    node = system / f"video{number}"
    node.mkdir(parents=True)
    (node / "name").write_text("DIGIT: DIGIT\n")
    (node / "index").write_text(f"{index}\n")
    (node / "device").symlink_to(usb_device / "interface")


@pytest.fixture
def system(tmp_path, monkeypatch):
    folder = tmp_path / "video4linux"
    folder.mkdir()
    monkeypatch.setattr(v4l2, "SYSTEM", folder)
    return folder


@pytest.fixture
def two(system):
    """A webcam, two DIGITs with two nodes each, the second with old firmware."""
    plug(system, 0, serial="W1", usb="046d:0825")
    plug(system, 2, serial="D20001")
    plug(system, 3, serial="D20001", index=1)
    plug(system, 10, serial="D20342", bcd="0100")
    plug(system, 11, serial="D20342", bcd="0100", index=1)
    return system


def test_units_are_found_by_usb_id(two):
    assert attached(two) == [
        Unit("/dev/video2", "D20001", 200),
        Unit("/dev/video10", "D20342", 100),
    ]
    assert attached(two.parent / "nothing") == []


def test_a_unit_without_a_revision(system):
    plug(system, 0, serial="D1", bcd="")
    assert attached() == [Unit("/dev/video0", "D1", None)]


def test_discovery_by_serial_number(two):
    assert Digit().discover() == ["/dev/video2", "/dev/video10"]
    assert Digit(serial="D20342").discover() == ["/dev/video10"]
    assert Digit(serial="D9").discover() == []


def test_which_one_must_be_clear(two):
    with pytest.raises(
        SensorError,
        match=r"fits /dev/video2 D20001, /dev/video10 D20342; choose with device=serial:D20001",
    ):
        Digit().open()
    with pytest.raises(SensorError, match="no camera serial:D9 is attached"):
        Digit(serial="D9").open()


class Device:
    """OpenCV's capture of a DIGIT, with the size and rate last set."""

    def __init__(self, zooms=True):
        self.asked, self.zooms = [], zooms

    def isOpened(self):
        return True

    def set(self, control, value):
        self.asked.append((control, value))
        return self.zooms or control != cv2.CAP_PROP_ZOOM

    def get(self, control):
        return float(dict(self.asked).get(control, 0.0))

    def grab(self):
        return True

    def retrieve(self):
        width, height = (int(self.get(c)) for c in (cv2.CAP_PROP_FRAME_WIDTH, 4))
        frame = np.zeros((height, width, 3), np.uint8)
        frame[:, : width // 2] = (10, 20, 200)  # blue, green, red
        return True, frame

    def release(self):
        pass


@pytest.fixture
def device(monkeypatch):
    made = Device()
    monkeypatch.setattr(camera, "open_capture", lambda source, backend: made)
    return made


@pytest.mark.parametrize(
    ("given", "size", "shape"),
    [
        ({}, (320, 240, 30), (320, 240)),
        ({"fps": 60}, (320, 240, 60), (320, 240)),
        ({"resolution": "vga"}, (640, 480, 30), (640, 480)),
        ({"resolution": "vga", "fps": 15}, (640, 480, 15), (640, 480)),
    ],
)
def test_modes(two, device, given, size, shape):
    with Digit(serial="D20001", **given) as sensor:
        assert (sensor.address, sensor.unit) == ("/dev/video2", "D20001")
        frame = sensor.read().array
        assert (sensor.spec.height, sensor.spec.width) == shape
        assert (sensor.spec.name, sensor.spec.fps) == ("digit", size[2])
    assert frame.shape == (*shape, 3)
    assert frame[-1, 0].tolist() == [200, 20, 10]  # upright: left is now below
    assert frame[0, 0].tolist() == [0, 0, 0]
    controls = [control for control, _ in device.asked]
    assert controls[:4] == [
        cv2.CAP_PROP_FOURCC,
        cv2.CAP_PROP_FRAME_WIDTH,
        cv2.CAP_PROP_FRAME_HEIGHT,
        cv2.CAP_PROP_FPS,  # after the size, which resets it
    ]
    assert tuple(value for _, value in device.asked[1:4]) == size


@pytest.mark.parametrize(
    ("lights", "value"), [(None, 0xFFF), ([15, 0, 3], 0xF03), ([0, 0, 0], 0), ([1, 2, 3], 0x123)]
)
def test_lights_are_four_bits_each(two, device, lights, value):
    with Digit(serial="D20001", lights=lights):
        assert dict(device.asked)[cv2.CAP_PROP_ZOOM] == value


def test_lights_of_old_firmware_are_left_alone(two, device):
    with Digit(serial="D20342"):
        assert cv2.CAP_PROP_ZOOM not in dict(device.asked)
    with pytest.raises(SensorError, match=r"firmware 1\.00 has another scale"):
        Digit(serial="D20342", lights=[1, 1, 1]).open()


def test_lights_that_are_refused(two, device):
    device.zooms = False
    with pytest.raises(SensorError, match="does not take lights=4095"):
        Digit(serial="D20001").open()


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"resolution": "hd"}, "a DIGIT has qvga, vga"),
        ({"fps": 15}, "with resolution=qvga a DIGIT has 60 or 30"),
        ({"resolution": "vga", "fps": 60}, "with resolution=vga a DIGIT has 30 or 15"),
        ({"lights": [16, 0, 0]}, "three numbers from 0 to 15"),
        ({"lights": [1]}, "three numbers from 0 to 15"),
    ],
)
def test_options_that_cannot_be(given, message):
    with pytest.raises(ConfigError, match=message):
        Digit(**given)
    assert packed([0, 15, 1]) == 0x0F1


@pytest.fixture
def video(tmp_path):
    """Three seconds of a camera on its side, at 30 frames a second."""
    path = tmp_path / "digit.avi"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 30, (320, 240))
    for i in range(80):
        writer.write(np.full((240, 320, 3), 3 * i, np.uint8))
    writer.release()
    return str(path)


def test_a_file_in_place_of_the_device_keeps_time_whoever_reads_late(video, clock):
    with Digit(device=video) as sensor:
        frames = [sensor.read() for _ in range(3)]
        clock.sleep(0.12)  # three frames are lost
        frames.append(sensor.read())
        numbers = [round(float(frame.array.mean()) / 3) for frame in frames]
    assert frames[0].array.shape == (320, 240, 3)
    assert numbers[3] - numbers[2] >= 3
    assert np.diff([f.time for f in frames]) == pytest.approx(np.diff(numbers) / 30, abs=1e-6)


def test_conformance_with_a_file(video):
    statuses = {result.name: result.status for result in check("sensor", "digit", device=video)}
    assert statuses.pop("discover with nothing attached gives nothing") == "skipped"
    assert set(statuses.values()) == {"ran"}


def test_conformance_with_nothing_attached(system):
    statuses = {result.name: result.status for result in check("sensor", "digit")}
    assert statuses["discover with nothing attached gives nothing"] == "ran"
    assert statuses["frames are as specified"] == "skipped"
    assert "failed" not in statuses.values()


def test_the_first_frames_are_thrown_away_as_they_may_be_green(two, device):
    grabbed = []
    device.grab = lambda: grabbed.append(1) or True
    with Digit(serial="D20001"):
        assert len(grabbed) == 10
