"""DM-Tac through the software of its maker, ``dmrobotics``; it is imported at opening."""

from __future__ import annotations

import time
from dataclasses import replace
from importlib import import_module
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from tactileforge.contracts import Frame, Sensor
from tactileforge.errors import ConfigError, SensorError, TactileForgeError
from tactileforge.specs import SPECS

#: Methods of the software, by picture: as the camera gives it, or cut and straightened.
PICTURES = {"raw": "getRawImg", "infer": "getInferImg"}


class DmTacSdk(Sensor):
    """A DM-Tac, read through ``dmrobotics``.

    Args:
        serial: Serial number, for example ``M2505150275``, or number of the device, from 0.
        picture: ``infer`` (cut and straightened) or ``raw`` (as its camera gives it).
        backend: Computing device: ``cpu``, ``cuda`` or a further one of the software.
        max_fps: Frames a second at most.
        remote: Address of a sensor on the network, for example ``192.168.127.10:50051``.

    Attributes:
        spec: Specification; once open, with height and width of the pictures.
        address: ``dmrobotics:SERIAL`` while it is open, else "".
    """

    spec = SPECS["dm"]

    def __init__(
        self,
        serial: str = "0",
        picture: str = "infer",
        backend: str = "cpu",
        max_fps: int = 120,
        remote: str = "",
    ) -> None:
        if picture not in PICTURES:
            raise ConfigError(f"picture={picture}: give {' or '.join(PICTURES)}")
        self.serial, self.picture, self.backend = str(serial), picture, backend
        self.max_fps, self.remote = max_fps, remote
        self.address = ""
        self._sensor: Any = None
        self._last = -1
        self._next: Frame | None = None

    def discover(self) -> list[str]:
        """Lists no device, as the software cannot enumerate them."""
        return []

    def open(self) -> None:
        """Claims the device.

        Raises:
            SensorError: The software is not installed, or the device absent or silent.
        """
        self.close()
        try:
            sdk = import_module("dmrobotics")
        except ImportError as error:
            raise SensorError(
                f"dmrobotics cannot be imported ({error}): pip install dmrobotics (its maker has "
                "it for Python 3.8 to 3.11), or use sensor=dmtac"
            ) from error
        name = self.remote or self.serial
        try:
            self._sensor = sdk.Sensor(sdk.SensorOptions(**self._options()))
        except Exception as error:  # the software documents no types of errors
            raise SensorError(f"DM-Tac {name}: cannot be opened ({error}); is it on?") from error
        self.address, self._last = f"dmrobotics:{name}", -1
        try:
            self._next = self.read(5.0)
        except TimeoutError as error:
            self.close()
            raise SensorError(f"DM-Tac {name}: gives no picture; plug it out and in") from error
        except BaseException:
            self.close()
            raise
        height, width = self._next.array.shape[:2]
        self.spec = replace(self.spec, height=height, width=width)

    def _options(self) -> dict[str, Any]:
        """Options of the software. Digits alone are the number of a device, not a serial number."""
        options = {
            "dev_id": int(self.serial) if self.serial.isdecimal() else self.serial,
            "backend": self.backend,
            "max_fps": self.max_fps,
            "enable_raw": self.picture == "raw",
        }
        return options | ({"remote_addr": self.remote} if self.remote else {})

    def read(self, timeout: float = 1.0) -> Frame:
        """Waits for the next picture; its time is that of its arrival.

        Raises:
            TactileForgeError: It is not open.
            SensorError: The software reports an error of the device.
            TimeoutError: No new picture within ``timeout`` seconds.
        """
        if self._next is not None:
            frame, self._next = self._next, None
            return frame
        sensor, end = self._sensor, time.monotonic() + timeout
        if sensor is None:
            raise TactileForgeError(
                "the sensor is not open: use it in a with block, or call open()"
            )
        while True:
            status = int(sensor.getDevStatus())
            if status:
                raise SensorError(f"{self.address}: status {status}; plug it out and in")
            left = max(0.0, end - time.monotonic())
            if sensor.wait_for_new(self._last, timeout_ms=round(1000 * left)):
                number, picture = getattr(sensor, PICTURES[self.picture])()
                if picture is not None and number != self._last:
                    self._last = number
                    return Frame(array=_rgb(picture), time=time.monotonic())
            if time.monotonic() >= end:
                raise TimeoutError(f"{self.address}: no picture within {timeout:g} s")

    def close(self) -> None:
        """Releases the device; a second call does nothing."""
        sensor, self._sensor, self.address, self._next = self._sensor, None, "", None
        if sensor is not None:
            sensor.disconnect()


def _rgb(picture: Any) -> NDArray[np.uint8]:
    """Converts a picture to RGB. Its pixels are bare or in ``img``, as BGR or grey."""
    pixels = np.asarray(getattr(picture, "img", picture))
    code = cv2.COLOR_GRAY2RGB if pixels.ndim == 2 else cv2.COLOR_BGR2RGB
    return np.ascontiguousarray(cv2.cvtColor(pixels, code))
