"""Cameras supported by OpenCV: UVC devices, network streams, and video files."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from tactileforge.contracts import Frame, Sensor, SensorSpec
from tactileforge.errors import ConfigError, SensorError, TactileForgeError
from tactileforge.sensors.drivers.v4l2 import (
    VideoDevice,
    attached_cameras,
    describe_choices,
    explain_failure,
    matching,
    video_devices,
)
from tactileforge.sensors.frame_contract import check_orientation
from tactileforge.specs.published import spec

# OpenCV's wait for a frame of a device, s; its default of 10 s would hide a lost camera for as
# long. OpenCV reads this once, when its V4L backend is first used.
os.environ.setdefault("OPENCV_VIDEOIO_V4L_SELECT_TIMEOUT", "2")

#: Shortest failed wait for a frame of an attached device, s: a lost one fails at once.
_AT_ONCE = 1.0
#: Manual exposure, V4L2_EXPOSURE_MANUAL of Video4Linux.
_MANUAL = 1


class Camera(Sensor):
    """A camera read by OpenCV.

    Requested options are checked: another resolution, or an unknown control, is an error. A driver
    of a known sensor subclasses it, gives the known options to ``super().__init__``, and overrides
    `adjust` or `prepare` if it needs more.

    A video file is played in real time: a frame comes when it is due, and a frame not read in time
    is lost.

    Args:
        device: Number, path, URL, ``usb:VENDOR:PRODUCT``, ``serial:NUMBER`` or ``name:PART`` of
            its name; or a video file.
        type: Name of the type of sensor, in recordings; see `tactileforge.specs.published`.
        width: Requested columns; None for the default of the camera.
        height: Requested rows; None for the default of the camera.
        fps: Requested frames a second; None for the default of the camera.
        fourcc: Requested pixel format, for example ``MJPG``.
        exposure: Exposure in the units of the camera; None for automatic.
        white_balance: Colour temperature, K; None for automatic.
        border: Share of height and width to cut off at each side.
        crop: Left, top, width and height to show after that, pixels; None for all.
        rotation: Degrees to turn it counter-clockwise after that: 0, 90, 180 or 270.
        resize: Final height and width, pixels; None for no resizing.
        warmup: Frames to throw away after opening.

    Attributes:
        spec: Spec of the type; once open, with height, width and rate of the frames.
        address: Path of the open device; "" for none, and for a file.
        unit: Serial number of the device; "" for none.
        damaged: Number of undecodable frames.
    """

    spec = SensorSpec(
        name="camera",
        height=480,
        width=640,
        fps=30.0,
        area_mm=None,
        force_scale=(5.0, 5.0, 10.0),
    )

    def __init__(
        self,
        device: str | int = "0",
        type: str = "camera",
        width: int | None = None,
        height: int | None = None,
        fps: float | None = None,
        fourcc: str = "",
        exposure: float | None = None,
        white_balance: float | None = None,
        border: float = 0.0,
        crop: Sequence[int] | None = None,
        rotation: int = 0,
        resize: Sequence[int] | None = None,
        warmup: int = 0,
    ) -> None:
        if rotation not in (0, 90, 180, 270):
            raise ConfigError(f"rotation={rotation}: give 0, 90, 180 or 270 degrees")
        if not 0 <= border < 0.5:
            raise ConfigError(f"border={border}: give the share to cut off, 0 or more, below 0.5")
        self.device = str(device)
        self.width, self.height, self.fps, self.fourcc = width, height, fps, fourcc
        self.exposure, self.white_balance = exposure, white_balance
        self.border, self.crop, self.rotation, self.resize = border, crop, rotation, resize
        self.warmup = warmup
        self.spec = self.spec if type == self.spec.name else spec(type, self.spec.name)
        if width and height:
            self.spec = self._specified((height, width), fps)
        self.address = self.unit = ""
        self.damaged = 0
        self._capture: Any = None
        self._size = (0, 0)
        self._is_file = False
        self._last = self._start = 0.0
        self._next = 0

    def discover(self) -> list[str]:
        """Paths of the attached cameras for ``device``; a file or URL itself."""
        device, there = self.device, video_devices()
        if "://" in device or Path(device).is_file():
            return [device]
        if device.isdigit():
            device = f"/dev/video{device}"
        chosen = [camera for camera in there if os.path.realpath(device) == camera.path]
        return [camera.path for camera in chosen or matching(device, there)]

    def open(self) -> None:
        """Open the camera, and set the requested controls.

        Raises:
            SensorError: The camera is absent, busy or ambiguous, refuses an option, or its frames
                lie on their side.
            ConfigError: The crop lies outside the frames.
        """
        self.close()
        source = self._locate()
        self._is_file = Path(source).is_file()
        is_device = source.startswith("/dev/")
        capture = open_capture(source, cv2.CAP_V4L2 if is_device else cv2.CAP_FFMPEG)
        self._capture = capture
        try:
            if not capture.isOpened():
                raise SensorError(explain_failure(source))
            self._set_up(capture, source)
            self.address = os.path.realpath(source) if is_device else ""
            there = (self.number(c) for c in video_devices() if c.path == self.address)
            self.unit = next(there, "")
            for _ in range(self.warmup):
                capture.grab()  # not decoded
        except BaseException:
            self.close()
            raise
        self._start, self._next = time.monotonic(), 0

    def number(self, camera: VideoDevice) -> str:
        """Serial number of an attached camera; "" for none."""
        return camera.serial

    def _locate(self) -> str:
        """Device, file or URL to open."""
        if self.device.isdigit():
            return f"/dev/video{self.device}" if sys.platform == "linux" else self.device
        if not self.device.startswith(("usb:", "serial:", "name:")):
            return self.device
        if sys.platform != "linux":
            raise SensorError(
                f"device={self.device} needs Linux, whose v4l2 lists cameras by name: here give "
                "the number of the camera, as in device=0"
            )
        paths = self.discover()
        if not paths:
            others = attached_cameras(video_devices())
            raise SensorError(f"no camera {self.device} is attached{others}; plug it in")
        if len(paths) > 1:
            raise SensorError(f"{self.device} fits {describe_choices(paths)}")
        return paths[0]

    def _set_up(self, capture: Any, source: str) -> None:
        if self.fourcc:  # first: it decides which resolutions and rates there are
            capture.set(cv2.CAP_PROP_FOURCC, cv2.VideoWriter.fourcc(*self.fourcc))
        asked = {
            "width": (cv2.CAP_PROP_FRAME_WIDTH, self.width),
            "height": (cv2.CAP_PROP_FRAME_HEIGHT, self.height),
            "fps": (cv2.CAP_PROP_FPS, self.fps),  # last: a new resolution resets it
        }
        for control, value in asked.values():
            if value is not None:
                capture.set(control, value)
        # read back: set() of V4L cameras succeeds with the nearest mode they have
        got = {name: float(capture.get(control)) for name, (control, _) in asked.items()}
        for name, (_, value) in asked.items():
            if value is not None and got[name] > 0 and abs(got[name] - value) > 0.01 * value:
                raise SensorError(
                    f"{source}: {name}={value:g} was asked for, and it gives {got[name]:g}; ask "
                    "for a mode that it has (v4l2-ctl --list-formats-ext)"
                )
        self._size = (int(got["height"]), int(got["width"]))
        self.spec = self._specified(self._size, got["fps"] if got["fps"] > 0 else None)
        check_orientation(self.spec)
        if not self._is_file:
            self.adjust(capture)

    def adjust(self, capture: Any) -> None:
        """Set the controls of a device just opened.

        Args:
            capture: Capture of OpenCV; see `control`.

        Raises:
            SensorError: Unknown control.
        """
        # automatic modes off first: cameras ignore or refuse values under their automatic control
        if self.exposure is not None:
            capture.set(cv2.CAP_PROP_AUTO_EXPOSURE, _MANUAL)
            self.control(capture, "exposure", cv2.CAP_PROP_EXPOSURE, self.exposure)
        if self.white_balance is not None:
            capture.set(cv2.CAP_PROP_AUTO_WB, 0)
            self.control(capture, "white_balance", cv2.CAP_PROP_WB_TEMPERATURE, self.white_balance)

    def control(self, capture: Any, name: str, control: int, value: float) -> None:
        """Set a control of the device.

        Args:
            capture: Capture of OpenCV.
            name: Name of the control, for messages.
            control: OpenCV's number of the control.
            value: Value in the units of the camera.

        Raises:
            SensorError: Unknown control.
        """
        if not capture.set(control, value):
            raise SensorError(
                f"{self.device}: it does not take {name}={value:g}; leave {name} out, or see its "
                "range (v4l2-ctl --list-ctrls)"
            )

    def _specified(self, size: tuple[int, int], fps: float | None) -> SensorSpec:
        """Spec of the prepared frames, given the size of captured ones."""
        height, width = self.prepare(np.zeros((*size, 3), np.uint8)).shape[:2]
        return replace(self.spec, height=height, width=width, fps=fps or self.spec.fps)

    def read(self, timeout: float = 1.0) -> Frame:
        """Read the next frame, with the time of the driver if it has one.

        Raises:
            TactileForgeError: The camera is not open.
            SensorError: The camera is gone, or the size of its frames has changed.
            TimeoutError: No frame within ``timeout`` seconds; a device may take two.
            EOFError: The end of a file.
        """
        end = time.monotonic() + timeout
        while True:
            capture = self._capture
            if capture is None:
                raise TactileForgeError(
                    "the camera is not open: use it in a with block, or call open()"
                )
            taken = self._play(capture, end) if self._is_file else self._grab(capture)
            good, frame = capture.retrieve()
            if good:
                break
            self.damaged += 1
            if time.monotonic() > end:
                raise TimeoutError(f"{self.device}: only frames that cannot be decoded")
        if frame.shape[:2] != self._size:
            got, want = "x".join(map(str, frame.shape[:2])), "x".join(map(str, self._size))
            raise SensorError(f"{self.device}: a frame of {got} pixels, and {want} before")
        self._last = taken
        return Frame(array=self.prepare(cv2.cvtColor(frame, cv2.COLOR_BGR2RGB)), time=taken)

    def _grab(self, capture: Any) -> float:
        """Wait for the next frame of a device; returns its time, monotonic seconds."""
        start = time.monotonic()
        good = capture.grab()
        now = time.monotonic()
        if not good:
            if now - start < _AT_ONCE or (self.address and not Path(self.address).exists()):
                raise SensorError(f"{self.device}: gives no frame any more; is it plugged in?")
            raise TimeoutError(f"{self.device}: no frame within {now - start:.1f} s")
        driver = float(capture.get(cv2.CAP_PROP_POS_MSEC)) / 1000
        # drivers of UVC cameras stamp frames by CLOCK_MONOTONIC, the clock of time.monotonic();
        # times of other drivers are of another clock, or 0
        return driver if self._last < driver <= now < driver + _AT_ONCE else now

    def _play(self, capture: Any, end: float) -> float:
        """Wait for the due time of a frame of a file, and skip late frames."""
        period = 1 / self.spec.fps
        if self._start + self._next * period > end:
            time.sleep(max(0.0, end - time.monotonic()))
            raise TimeoutError(f"{self.device}: the next frame is not due yet")
        while True:
            if not capture.grab():
                raise EOFError(f"{self.device}: its frames are over")
            due = self._start + self._next * period
            self._next += 1
            wait = due - time.monotonic()
            if wait > -period:
                time.sleep(max(0.0, wait))
                return due

    def prepare(self, frame: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """Cut, turn and resize a frame.

        Args:
            frame: Captured frame, uint8 (H, W, 3), RGB.

        Returns:
            uint8 (height, width, 3), with the size of the spec.
        """
        high, wide = int(self.border * frame.shape[0]), int(self.border * frame.shape[1])
        frame = frame[high : frame.shape[0] - high, wide : frame.shape[1] - wide]
        if self.crop is not None:
            left, top, width, height = self.crop
            rows, columns = frame.shape[:2]
            is_inside = left + width <= columns and top + height <= rows
            if min(left, top) < 0 or min(width, height) < 1 or not is_inside:
                raise ConfigError(
                    f"crop={list(self.crop)} (left, top, width, height) lies outside frames of "
                    f"{columns}x{rows} pixels"
                )
            frame = frame[top : top + height, left : left + width]
        frame = np.rot90(frame, self.rotation // 90)
        if self.resize is not None:
            height, width = self.resize
            frame = cv2.resize(frame, (width, height), interpolation=cv2.INTER_AREA)
        return np.ascontiguousarray(frame)

    def close(self) -> None:
        """Release the camera; a second call does nothing."""
        capture, self._capture = self._capture, None
        self.address = self.unit = ""
        if capture is not None:
            capture.release()


def open_capture(source: str, backend: int) -> Any:
    """Open a device, file or URL by OpenCV, without its log messages."""
    level = cv2.utils.logging.getLogLevel()
    cv2.utils.logging.setLogLevel(0)
    try:
        if source.isdigit():  # not on Linux: cameras have only numbers there
            return cv2.VideoCapture(int(source))
        return cv2.VideoCapture(source, backend)
    finally:
        cv2.utils.logging.setLogLevel(level)
