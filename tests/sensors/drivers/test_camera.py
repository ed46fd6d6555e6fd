"""Cameras, against real video read by OpenCV itself, and against a misbehaving capture."""

import errno
import time

import cv2
import numpy as np
import pytest
from videos import write_video

from tactileforge.errors import ConfigError, SensorError, TactileForgeError
from tactileforge.sensors.drivers import camera as module
from tactileforge.sensors.drivers import v4l2
from tactileforge.sensors.drivers.camera import Camera
from tactileforge.sensors.drivers.v4l2 import VideoDevice, matching, video_devices
from tactileforge.testing import check
from tactileforge.testing.clock import FakeTime

FPS = 25


@pytest.fixture
def video(tmp_path):
    """Twelve frames of 48 x 64: red left of the middle, the i-th of blue 20 * i."""
    frames = np.zeros((12, 48, 64, 3), np.uint8)
    frames[..., 2] = 20 * np.arange(12)[:, None, None]
    frames[:, :, :32, 0] = 200
    return str(write_video(tmp_path / "press.avi", frames, FPS))


def blue(frame):
    return round(float(frame.array[..., 2].mean()) / 20)


def read_all(sensor):
    frames = []
    try:
        while True:
            frames.append(sensor.read())
    except EOFError:
        return frames


@pytest.fixture
def clock(monkeypatch):
    """The time of cameras; it passes only in sleep."""
    made = FakeTime()
    monkeypatch.setattr(module, "time", made)
    return made


def test_a_file_is_played_in_real_time_in_rgb(video, clock):
    with Camera(video) as sensor:
        assert (sensor.spec.height, sensor.spec.width, sensor.spec.fps) == (48, 64, FPS)
        frames = read_all(sensor)
        end = clock.monotonic()
    seen = [blue(frame) for frame in frames]
    assert seen == list(range(12))
    assert frames[-1].time <= end, "no frame comes before it is due"
    times = [frame.time for frame in frames]
    assert np.diff(times) == pytest.approx(np.diff(seen) / FPS, abs=1e-6)  # dropped or not
    red = frames[0].array[..., 0].mean(0)
    assert red[:24].min() > 170 > 30 > red[40:].max()


def test_frames_that_nobody_read_are_lost(video, clock):
    with Camera(video) as sensor:
        first = sensor.read()
        clock.sleep(5.5 / FPS)
        late = sensor.read()
    assert blue(late) >= 5
    assert late.time - first.time == pytest.approx((blue(late) - blue(first)) / FPS, abs=1e-6)


def test_a_frame_that_is_not_due_is_a_timeout_and_comes_later(video, clock):
    with Camera(video) as sensor:
        seen = [blue(sensor.read())]
        for _ in range(200):
            try:
                seen.append(blue(sensor.read(0.005)))
            except TimeoutError:
                continue
            if len(seen) == 4:
                break
    assert seen == [0, 1, 2, 3]


@pytest.mark.parametrize(
    ("given", "shape"),
    [
        ({"rotation": 90}, (64, 48)),
        ({"rotation": 180}, (48, 64)),
        ({"crop": [32, 0, 32, 40]}, (40, 32)),
        ({"border": 0.25}, (24, 32)),
        ({"resize": [12, 20]}, (12, 20)),
        ({"border": 1 / 7, "rotation": 270, "resize": [320, 240]}, (320, 240)),
    ],
)
def test_frames_are_cut_turned_and_resized(video, given, shape):
    with Camera(video, **given) as sensor:
        frame = sensor.read().array
        assert frame.shape == (*shape, 3)
        assert (sensor.spec.height, sensor.spec.width) == shape
        assert frame.flags.c_contiguous


def test_turns_are_counter_clockwise(video):
    """The red left half comes to lie at the bottom, as that of a DIGIT turned upright."""
    with Camera(video, rotation=90) as sensor:
        red = sensor.read().array[..., 0].mean(1)
    assert red[-20:].min() > 170 > 30 > red[:20].max()


def test_conformance(video):
    statuses = {result.name: result.status for result in check("sensor", "camera", device=video)}
    assert statuses.pop("discover with nothing attached gives nothing") == "skipped"
    assert set(statuses.values()) == {"ran"}


def test_conformance_without_a_camera():
    statuses = {result.name: result.status for result in check("sensor", "camera", device="97")}
    assert statuses["discover with nothing attached gives nothing"] == "ran"
    assert statuses["frames are as specified"] == "skipped"
    assert "failed" not in statuses.values()


@pytest.mark.realdata
def test_the_real_video_of_a_sensor_is_read_as_opencv_reads_it(realdata, clock):
    """Frame by frame, by its time; none is taken for another."""
    path = str(realdata / "gelsight_mini_marker_video" / "mini_example.avi")
    capture, true = cv2.VideoCapture(path), []
    while len(true) < 25:
        true.append(capture.read()[1][..., ::-1])
    capture.release()
    with Camera(path, type="gelsight_mini") as sensor:
        frames = []
        while not frames or frames[-1].time - frames[0].time < 0.6:
            frames.append(sensor.read())
            clock.sleep(0.03 if len(frames) % 4 else 0.1)  # a reader that is late now and then
        rate = sensor.spec.fps
    for frame in frames:
        number = round((frame.time - frames[0].time) * rate)
        assert np.array_equal(frame.array, true[number])


class Device:
    """OpenCV's capture of a scripted device.

    Args:
        grabs: What each grab gives: seconds that it takes, or False after no time.
        size: Width and height of its frames.
        refuses: Controls that it does not know.
        stamps: Times of the driver, ms.
    """

    def __init__(self, grabs=(), size=(64, 48), refuses=(), stamps=(), fps=30.0):
        self.grabs, self.stamps = iter(grabs), iter(stamps)
        self.values = {cv2.CAP_PROP_FPS: fps}
        self.size, self.refuses = size, refuses
        self.is_released = False
        self.broken = 0

    def isOpened(self):
        return True

    def set(self, control, value):
        self.values.setdefault("asked", []).append((control, value))
        return control not in self.refuses

    def get(self, control):
        if control == cv2.CAP_PROP_POS_MSEC:
            return next(self.stamps, 0.0)
        width, height = self.size
        sizes = {cv2.CAP_PROP_FRAME_WIDTH: width, cv2.CAP_PROP_FRAME_HEIGHT: height}
        return float({**self.values, **sizes}[control])

    def grab(self):
        wait = next(self.grabs, 0.0)
        time.sleep(wait or 0.0)
        return wait is not False

    def retrieve(self):
        self.broken -= 1
        if self.broken >= 0:
            return False, None
        return True, np.zeros((self.size[1], self.size[0], 3), np.uint8)

    def release(self):
        self.is_released = True


@pytest.fixture
def device(monkeypatch):
    """Puts a device in place of /dev/video0."""

    def put(*given, **options):
        made = Device(*given, **options)
        monkeypatch.setattr(module, "open_capture", lambda source, backend: made)
        return made

    return put


def test_what_is_asked_for_is_set_in_order(device):
    made = device(size=(320, 240), fps=60)
    with Camera(0, width=320, height=240, fps=60, fourcc="MJPG", exposure=180, white_balance=4500):
        pass
    asked = [control for control, _ in made.values["asked"]]
    assert asked[:4] == [
        cv2.CAP_PROP_FOURCC,
        cv2.CAP_PROP_FRAME_WIDTH,
        cv2.CAP_PROP_FRAME_HEIGHT,
        cv2.CAP_PROP_FPS,
    ]
    assert (cv2.CAP_PROP_AUTO_EXPOSURE, 1) in made.values["asked"]
    assert (cv2.CAP_PROP_WB_TEMPERATURE, 4500) in made.values["asked"]
    assert made.is_released


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"width": 640}, "width=640 was asked for, and it gives 64"),
        ({"fps": 60}, "fps=60 was asked for, and it gives 30"),
        ({"exposure": 5}, "does not take exposure=5"),
    ],
)
def test_a_device_that_does_not_do_what_is_asked(device, given, message):
    made = device(refuses=[cv2.CAP_PROP_EXPOSURE])
    with pytest.raises(SensorError, match=message):
        Camera(0, **given).open()
    assert made.is_released


def test_a_device_that_is_unplugged(device):
    device(grabs=[0.0, False])
    with Camera(0) as sensor:
        sensor.read()
        with pytest.raises(SensorError, match="gives no frame any more"):
            sensor.read()


def test_a_device_that_is_silent(device, monkeypatch):
    made = device()
    monkeypatch.setattr(module, "_AT_ONCE", 0.05)
    made.grab = lambda: bool(time.sleep(0.1))
    with Camera(0) as sensor:
        sensor.address = "/dev/null"  # which is still there
        with pytest.raises(TimeoutError, match=r"no frame within 0\.1 s"):
            sensor.read()


def test_frames_that_cannot_be_decoded_are_passed_over_and_counted(device):
    made = device()
    made.broken = 2
    with Camera(0) as sensor:
        sensor.read()
        assert sensor.damaged == 2


def test_frames_that_change_their_size(device):
    made = device()
    with Camera(0) as sensor:
        sensor.read()
        made.size = (32, 24)
        with pytest.raises(SensorError, match="a frame of 24x32 pixels, and 48x64 before"):
            sensor.read()


def test_the_time_is_that_of_the_driver_where_it_can_be_true(device):
    now = time.monotonic()
    device(stamps=[(now - 0.02) * 1e3, 5.0, (now + 9) * 1e3, (now - 0.5) * 1e3])
    with Camera(0) as sensor:
        times = [sensor.read().time for _ in range(4)]
    assert times[0] == pytest.approx(now - 0.02, abs=1e-9)
    assert all(0 <= one - now < 5 for one in times[1:])
    assert (np.diff(times) > 0).all()


def test_why_a_device_cannot_be_opened(tmp_path, monkeypatch):
    with pytest.raises(SensorError, match=r"/dev/video97: no such camera \(attached: .*plug it in"):
        Camera(97).open()
    noise = tmp_path / "noise.avi"
    noise.write_bytes(b"no video")
    with pytest.raises(SensorError, match="not a video that can be read"):
        Camera(str(noise)).open()
    for number, message in ((errno.EBUSY, "is another program"), (errno.EACCES, "group video")):

        def refuse(*given, number=number):
            raise OSError(number, "refused")

        monkeypatch.setattr(v4l2.os, "open", refuse)
        assert message in v4l2.explain_failure("/dev/null")


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"rotation": 45}, "rotation=45: give 0, 90, 180 or 270"),
        ({"border": 0.5}, "border=0.5"),
        ({"type": "camra"}, "unknown sensor 'camra'; did you mean 'camera'"),
        ({"width": 8, "height": 8, "crop": [0, 0, 9, 2]}, "lies outside frames of 8x8 pixels"),
    ],
)
def test_options_that_cannot_be(given, message):
    with pytest.raises(ConfigError, match=message):
        Camera(0, **given)


def test_read_needs_an_open_camera():
    with pytest.raises(TactileForgeError, match="not open"):
        Camera(0).read()


@pytest.fixture
def system(tmp_path):
    """Linux device entries of a DIGIT with two nodes, and of a GelSight Mini."""
    usb = tmp_path / "usb"
    for port, vendor, product, serial in (
        ("1-1", "2833", "0209", "D20123"),
        ("1-2", "0c45", "636d", ""),
    ):
        (usb / port / "interface").mkdir(parents=True)
        (usb / port / "idVendor").write_text(f"{vendor}\n")
        (usb / port / "idProduct").write_text(f"{product}\n")
        if serial:
            (usb / port / "serial").write_text(f"{serial}\n")
    listed = tmp_path / "video4linux"
    for node, port, name, index in (
        ("video10", "1-2", "GelSight Mini R0B 2AB3-C4D5", 0),
        ("video2", "1-1", "DIGIT: DIGIT", 0),
        ("video3", "1-1", "DIGIT: DIGIT", 1),
    ):
        (listed / node).mkdir(parents=True)
        (listed / node / "name").write_text(f"{name}\n")
        (listed / node / "index").write_text(f"{index}\n")
        (listed / node / "device").symlink_to(usb / port / "interface")
    return listed


def test_cameras_are_listed_by_number_without_their_metadata(system):
    assert video_devices(system) == [
        VideoDevice("/dev/video2", "DIGIT: DIGIT", "2833:0209", "D20123"),
        VideoDevice("/dev/video10", "GelSight Mini R0B 2AB3-C4D5", "0c45:636d", ""),
    ]
    assert video_devices(system / "none") == []


@pytest.mark.parametrize(
    ("words", "path"),
    [
        ("usb:0C45:636D", "/dev/video10"),
        ("serial:D20123", "/dev/video2"),
        ("name:gelsight mini", "/dev/video10"),
        ("serial:D2", None),
        ("video2", None),
    ],
)
def test_cameras_are_found_by_what_they_are(system, words, path, monkeypatch):
    found = matching(words, video_devices(system))
    assert [one.path for one in found] == ([path] if path else [])
    monkeypatch.setattr("tactileforge.sensors.drivers.v4l2.SYSTEM", system)
    assert Camera(words).discover() == ([path] if path else [])


def test_a_camera_that_is_named_and_absent_or_double(system, monkeypatch):
    monkeypatch.setattr("tactileforge.sensors.drivers.v4l2.SYSTEM", system)
    with pytest.raises(SensorError, match=r"no camera serial:D9 is attached \(attached: /dev/vid"):
        Camera("serial:D9").open()
    with pytest.raises(SensorError, match=r"fits /dev/video2 D20123, /dev/video10; serial"):
        Camera("name:i").open()


@pytest.mark.parametrize("words", ["usb:2833:0209", "serial:D20123", "name:DIGIT"])
@pytest.mark.parametrize("other", ["win32", "darwin"])
def test_a_camera_is_named_on_linux_only(words, other, monkeypatch):
    monkeypatch.setattr("sys.platform", other)
    said = f"^device={words} needs Linux, whose v4l2 .*: here give .* device=0$"
    with pytest.raises(SensorError, match=said):
        Camera(words).open()


def test_cameras_that_share_a_serial_number_are_chosen_by_socket(monkeypatch, tmp_path):
    two = [VideoDevice(f"/dev/video{n}", "DIGIT: DIGIT", "2833:0209", "DXXXXX") for n in (4, 6)]
    monkeypatch.setattr(v4l2, "video_devices", lambda: two)
    monkeypatch.setattr(module, "video_devices", lambda: two)
    monkeypatch.setattr(v4l2, "BY_PATH", tmp_path)
    for n in (4, 6):
        (tmp_path / f"usb-{n}").symlink_to(f"/dev/video{n}")
    for words in ("usb:2833:0209", "serial:DXXXXX"):
        with pytest.raises(SensorError) as caught:
            Camera(words).open()
        assert str(caught.value) == (
            f"{words} fits /dev/video4 DXXXXX, /dev/video6 DXXXXX; serial numbers do not tell them "
            f"apart: choose by socket, with device={tmp_path}/usb-4 or device={tmp_path}/usb-6"
        )
    with pytest.raises(SensorError, match=r"attached: /dev/video4 DIGIT: DIGIT DXXXXX, /dev/vid"):
        Camera("serial:D20001").open()


def test_a_known_sensor_that_lies_on_its_side_is_named_when_it_is_opened(video):
    with pytest.raises(SensorError, match="lie on their side: those of a digit are upright"):
        Camera(video, type="digit").open()
    with Camera(video, type="digit", rotation=90) as sensor:
        assert sensor.read().array.shape == (64, 48, 3)
    Camera(video, rotation=90).open()  # nobody knows how another camera stands
