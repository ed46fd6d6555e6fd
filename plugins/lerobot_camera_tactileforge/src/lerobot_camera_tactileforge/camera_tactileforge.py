"""A touch sensor as a camera of LeRobot."""

from __future__ import annotations

import threading
import time
from contextlib import suppress
from typing import Any

import cv2
import numpy as np
from lerobot.cameras.camera import Camera
from lerobot.utils.errors import DeviceAlreadyConnectedError, DeviceNotConnectedError
from numpy.typing import NDArray

from lerobot_camera_tactileforge.config_tactileforge import TactileForgeCameraConfig
from tactileforge.checks import StreamChecks
from tactileforge.contracts import Frame, Sensor
from tactileforge.errors import TactileForgeError
from tactileforge.plugins import build, names
from tactileforge.sensors import Capture, close_sensor, open_sensor

#: Longest wait for the first frame, and for a frame in `read`, s.
_FIRST, _READ = 10.0, 5.0
#: Time between two checks of a silent sensor, s: a lost one ends the wait early.
_LOOK = 0.1


class TactileForgeCamera(Camera):
    """A sensor plugin, read in a thread of its own; a lost one is opened again.

    Frames are uint8 (height, width, 3), RGB. The frames of an array of taxels are its picture, in
    which 128 is the value without contact.

    Args:
        config: Sensor plugin, its options, and size and rate of the frames.
    """

    def __init__(self, config: TactileForgeCameraConfig) -> None:
        super().__init__(config)
        self.config = config
        self._capture: Capture | None = None
        self._sensor: Sensor | None = None
        self._new = threading.Condition()
        self._frame: Frame | None = None
        self._number = self._seen = 0

    def __str__(self) -> str:
        return f"TactileForgeCamera({self.config.sensor})"

    @property
    def is_connected(self) -> bool:
        """Whether it is open."""
        return self._capture is not None

    @staticmethod
    def find_cameras() -> list[dict[str, Any]]:
        """Lists the attached sensors of all plugins of kind ``image`` or ``array``."""
        found = []
        for name in names("sensors"):
            try:
                sensor: Sensor = build("sensors", {"name": name})
                addresses = sensor.discover() if sensor.spec.kind in ("image", "array") else []
            except Exception:  # the plugin needs options, or its SDK is not installed
                continue
            shape = {"width": sensor.spec.width, "height": sensor.spec.height}
            profile = {**shape, "fps": sensor.spec.fps, "format": "RGB"}
            found += [
                {
                    "type": "tactileforge",
                    "name": f"{sensor.spec.name} {address}",
                    "id": address,
                    "sensor": name,
                    "default_stream_profile": profile,
                }
                for address in addresses
            ]
        return found

    def connect(self, warmup: bool = True) -> None:
        """Opens the sensor.

        Args:
            warmup: Whether to wait for the first frame.

        Raises:
            DeviceAlreadyConnectedError: It is open.
            ConnectionError: It is absent, busy, or gives no frame.
        """
        if self.is_connected:
            raise DeviceAlreadyConnectedError(f"{self} is connected already")
        self._frame, self._number, self._seen = None, 0, 0
        self._sensor = self.config.build()
        try:
            open_sensor(self.config.sensor, self._sensor)
        except TactileForgeError as error:
            with suppress(TactileForgeError):  # the device may hang or fail here as well
                close_sensor(self.config.sensor, self._sensor)
            raise ConnectionError(f"{self} cannot be opened: {error}") from error
        name, reconnect = self.config.sensor, self.config.reconnect
        checks = StreamChecks(name, self._sensor.spec)
        self._capture = Capture(name, self._sensor, self._take, reconnect, checks=checks)
        self._capture.start()
        if warmup:
            try:
                self._wait(_FIRST)
            except (TimeoutError, ConnectionError) as error:
                with suppress(ConnectionError):
                    self.disconnect()
                raise ConnectionError(f"{self} gives no frame: {error}") from error

    def _take(self, frame: Frame) -> None:
        """Keeps a frame; called in the sensor's thread."""
        with self._new:
            self._frame, self._number = frame, self._number + 1
            self._new.notify_all()

    def _wait(self, seconds: float) -> Frame:
        """Waits for an unread frame, and returns the newest.

        Raises:
            TimeoutError: No unread frame comes in time.
            ConnectionError: The sensor has ended or is gone.
        """
        capture, end = self._opened(), time.monotonic() + seconds
        with self._new:
            while self._number == self._seen:
                capture.watch()
                if capture.is_done:
                    raise ConnectionError(f"{self}: {capture.error or 'its source has ended'}")
                left = end - time.monotonic()
                if left <= 0:
                    raise TimeoutError(f"{self}: no new frame within {1000 * seconds:.0f} ms")
                self._new.wait(min(left, _LOOK))
            assert self._frame is not None
            return self._frame

    def _opened(self) -> Capture:
        if self._capture is None:
            raise DeviceNotConnectedError(f"{self} is not connected; call connect()")
        return self._capture

    def _show(self, frame: Frame) -> NDArray[np.uint8]:
        size = (int(self.width or 1), int(self.height or 1))
        if frame.array.shape[1::-1] == size:
            return frame.array
        smaller = size[0] < frame.array.shape[1]
        how = cv2.INTER_AREA if smaller else cv2.INTER_LINEAR
        return np.asarray(cv2.resize(frame.array, size, interpolation=how), np.uint8)

    def read(self) -> NDArray[np.uint8]:
        """Waits for the next frame, from now on.

        Raises:
            DeviceNotConnectedError: It is not open.
            TimeoutError: No frame comes within 5 s.
            ConnectionError: The sensor is lost, and does not come back.
        """
        with self._new:
            self._seen = self._number
        return self.async_read(1000 * _READ)

    def async_read(self, timeout_ms: float = 200) -> NDArray[np.uint8]:
        """Returns the newest unread frame, and waits for one if necessary.

        It raises the same errors as `read`.

        Args:
            timeout_ms: Longest wait, ms.
        """
        frame = self._wait(timeout_ms / 1000)
        with self._new:
            self._seen = self._number
        return self._show(frame)

    def read_latest(self, max_age_ms: int = 500) -> NDArray[np.uint8]:
        """Returns the newest frame without waiting; it may have been read already.

        Raises:
            DeviceNotConnectedError: It is not open.
            RuntimeError: No frame has come yet.
            TimeoutError: The newest frame is older than ``max_age_ms``.
        """
        self._opened()
        frame = self._frame
        if frame is None:
            raise RuntimeError(f"{self} has given no frame yet")
        age = 1000 * (time.monotonic() - frame.time)
        if age > max_age_ms:
            raise TimeoutError(f"{self}: its newest frame is {age:.0f} ms old")
        return self._show(frame)

    def disconnect(self) -> None:
        """Closes the sensor.

        Raises:
            DeviceNotConnectedError: It is not open.
            ConnectionError: Its driver fails or hangs; the sensor is then left open.
        """
        capture, self._capture = self._opened(), None
        capture.stop()
        assert self._sensor is not None
        try:
            close_sensor(self.config.sensor, self._sensor)
        except TactileForgeError as error:
            raise ConnectionError(f"{self} cannot be closed: {error}") from error
