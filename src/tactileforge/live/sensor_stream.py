"""Live estimates of one sensor from its frames and background."""

from __future__ import annotations

import threading
import time
from collections import deque
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from tactileforge.calibration.file import Calibration
from tactileforge.contracts import Frame, Sensor
from tactileforge.data.batches.clips import resize_frame
from tactileforge.depth import DepthReader
from tactileforge.errors import ConfigError, SensorError, unknown
from tactileforge.hub.model import Model
from tactileforge.live.buffer import ClipBuffer, FrameWithClip
from tactileforge.live.contact import (
    BackgroundChange,
    ContactDetector,
    ContactOptions,
    SlipEstimator,
    SlipOptions,
)
from tactileforge.sensors import background
from tactileforge.sensors.background import Background
from tactileforge.sensors.capture import Capture
from tactileforge.sensors.health import exposure_trouble

#: Readings that are kept for the page.
HISTORY = 512
#: Frames that are looked at for a background.
_LOOKED_AT = 60


@dataclass(frozen=True)
class Reading:
    """Contact, force and slip estimated from one frame.

    Attributes:
        sensor: Name of the sensor.
        number: Of the frame, counted from 1.
        time: When it was taken, monotonic seconds.
        difference: From the background, grey levels.
        contact: Whether anything touches; None where the image is invalid.
        force: N, x, y and z; None where the model gives none, or the image is invalid.
        slip: See `contact.Slip`; None without forces.
        latency: Seconds from the frame to this reading.
        trouble: One of `health.TROUBLES`; "" for none.
        vector: The model's vector; None where it is not asked for.
        depth: float32 (h, w), mm into the gel; None where it is not asked for, or the image is
            invalid.
    """

    sensor: str
    number: int
    time: float
    difference: float
    contact: bool | None
    force: tuple[float, float, float] | None
    slip: bool | None
    latency: float
    trouble: str = ""
    vector: NDArray[np.float32] | None = None
    depth: NDArray[np.float32] | None = None

    def message(self) -> dict[str, Any]:
        """The reading as plain data, for publishers."""
        message: dict[str, Any] = {
            "sensor": self.sensor,
            "frame": self.number,
            "time": round(self.time, 6),
            "unix": round(time.time() - time.monotonic() + self.time, 6),
            "force": None if self.force is None else [round(axis, 4) for axis in self.force],
            "contact": self.contact,
            "slip": self.slip,
            "difference": round(self.difference, 2),
            "latency_ms": round(1000 * self.latency, 2),
        }
        if self.trouble:
            message["trouble"] = self.trouble
        if self.depth is not None:
            message["depth_mm"] = round(float(self.depth.max()), 3)
        if self.vector is not None:
            message["embedding"] = [round(float(x), 5) for x in self.vector]
        return message


class SensorStream:
    """A sensor read in a thread; readings of the newest frame are computed on request.

    Args:
        name: Of the sensor.
        sensor: Open.
        model: What encodes it; None for contact alone.
        wake: Is notified when a frame has come.
        contact: When something touches.
        slip: When something slips.
        reconnect: Seconds for which a sensor that is lost is waited for.
        unknown_sensor: What to do where the model does not know the sensor, see `Model.encode`.
        calibration: Of this unit, for the model's forces; see `Model.force`.
        depth: Reads depth; None for none.

    Attributes:
        background: uint8 (H, W, 3), the frame without contact.
        readings: The last ones.
        skipped: Frames that no reading was computed of, because a newer one had come.
        done: Frames of which a reading was computed.

    Raises:
        ConfigError: The model does not know the sensor, or the calibration is of another.
    """

    def __init__(
        self,
        name: str,
        sensor: Sensor,
        model: Model | None,
        wake: threading.Condition,
        contact: ContactOptions,
        slip: SlipOptions,
        reconnect: float = 10.0,
        unknown_sensor: str = "error",
        calibration: Calibration | None = None,
        depth: DepthReader | None = None,
    ) -> None:
        self.calibration, self.depth = calibration, depth
        if calibration is not None and model is not None:
            model.axes_of(calibration, [sensor.spec.name])
        self.name, self.sensor, self.model, self.wake = name, sensor, model, wake
        self.type = known_as(sensor.spec.name, model, unknown_sensor)
        frames, spacing = (1, 0.0) if model is None else (model.frames, model.spacing)
        self.buffer = ClipBuffer(frames, spacing, self.prepare)
        self.capture = Capture(name, sensor, self.sink, reconnect)
        self.contact, self.slip = ContactDetector(contact), SlipEstimator(slip)
        self.background: NDArray[np.uint8] = np.zeros((1, 1, 3), np.uint8)
        self.readings: deque[Reading] = deque(maxlen=HISTORY)
        self.skipped = self.done = 0
        self.shown: Frame | None = None
        self._seen: list[NDArray[np.uint8]] | None = None
        self._still = self.background
        self._difference = BackgroundChange(self.background)
        self._last = self._frozen = 0

    def prepare(self, image: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """Prepares an image as in training.

        A model that was trained here saw images of the size of its input; what was imported does
        its own resizing.
        """
        if self.model is None or not self.model.recipe:
            return image
        return resize_frame(image, self.model.encoder.image_size)

    def sink(self, frame: Frame) -> None:
        """Receives a frame in the sensor's thread."""
        seen = self._seen
        if seen is not None and len(seen) < _LOOKED_AT:
            seen.append(frame.array)
        self._frozen = self.capture.counts.frozen
        self.buffer.push(frame)
        with self.wake:
            self.wake.notify()

    def begin_background(self) -> None:
        """Begins to keep frames without contact."""
        self._seen = []

    def take_background(self, options: Background, image: NDArray[np.uint8] | None) -> None:
        """Takes the background from the frames since `begin_background`, or as given.

        Args:
            options: ``seconds`` 0 takes the newest frame, unchecked.
            image: uint8 (H, W, 3), RGB; None takes the frames.

        Raises:
            SensorError: Something touches, or there is no image.
            ConfigError: The image has another size than the frames.
        """
        seen, self._seen = self._seen or [], None
        spec = self.sensor.spec
        if image is not None:
            if image.shape[:2] != (spec.height, spec.width):
                raise ConfigError(
                    f"{self.name}: the background has {image.shape[:2]} pixels, and its frames "
                    f"{(spec.height, spec.width)}"
                )
            self.background = image
        elif options.seconds:
            background.check_background(self.name, seen, options.threshold)
            chosen = background.spread_frames(seen, options.frames)
            self.background = np.median(chosen, axis=0).astype(np.uint8)
        else:
            shot = self.buffer.newest()
            if shot is None:
                raise SensorError(f"{self.name}: no frame came for its background")
            self.background = shot.frame.array
        self._still = self.prepare(self.background)
        self._difference = BackgroundChange(self.background)

    @property
    def state(self) -> str:
        """``lost``, one of `health.TROUBLES`, or "" where all is well."""
        if self.capture.is_lost:
            return "lost"
        if self.capture.counts.frozen > self._frozen:
            return "frozen"
        return self.readings[-1].trouble if self.readings else ""

    @property
    def is_fresh(self) -> bool:
        """Whether a frame has come since the last reading."""
        return self.buffer.count > self._last

    def read(self, with_vector: bool = False) -> Reading | None:
        """The reading of the newest frame; None where there is no new one, or no clip yet."""
        shot = self.buffer.newest()
        if shot is None or shot.number == self._last:
            return None
        behind, self._last = shot.number - self._last - 1, shot.number
        self.shown = shot.frame
        if shot.clip is None:
            return None
        self.skipped += behind if self.done else 0
        self.done += 1
        reading = self._read(shot, with_vector)
        self.readings.append(reading)
        return reading

    def _read(self, shot: FrameWithClip, with_vector: bool) -> Reading:
        frame = shot.frame
        trouble = exposure_trouble(frame.array) if self.sensor.spec.kind == "image" else ""
        difference = self._difference(frame.array)
        contact: bool | None = None
        force: NDArray[np.float32] | None = None
        slip: bool | None = None
        vector: NDArray[np.float32] | None = None
        if not trouble:
            contact = self.contact.update(difference)
            if self.model is not None and shot.clip is not None:
                readings = self.model.readings(
                    shot.clip, self._still, self.type, calibration=self.calibration
                )
                force = None if readings.force is None else readings.force[-1].cpu().numpy()
                vector = readings.vector.cpu().numpy() if with_vector else None
            if force is not None:
                slip = self.slip.update(frame.time, force, contact)
        depth = None if trouble else self._depth(frame.array)
        return Reading(
            self.name,
            shot.number,
            frame.time,
            difference,
            contact,
            None if force is None else (float(force[0]), float(force[1]), float(force[2])),
            slip,
            time.monotonic() - frame.time,
            trouble,
            vector,
            depth,
        )

    def _depth(self, image: NDArray[np.uint8]) -> NDArray[np.float32] | None:
        if self.depth is None or image.shape != self.background.shape:
            return None
        found: NDArray[np.float32] = self.depth.read(image, self.background).depth.numpy()
        return found


def known_as(name: str, model: Model | None, unknown_sensor: str) -> str:
    """The name by which the model knows a type of sensor.

    Raises:
        ConfigError: It does not know it, and ``unknown_sensor`` is ``error``.
    """
    if unknown_sensor not in ("error", "universal"):
        raise ConfigError(f"unknown_sensor={unknown_sensor}: give error or universal")
    if model is None or not model.sensors or name in model.sensors:
        return name
    has_universal = getattr(model.encoder, "universal", None) is not None
    if unknown_sensor == "universal" and has_universal:
        return "universal"
    fix = "unknown_sensor=universal takes the tokens that fit no sensor, and gives no force."
    raise ConfigError(unknown("sensor of the model", name, model.sensors, fix * has_universal))


def read_background(path: str) -> NDArray[np.uint8]:
    """A background from a file, uint8 (H, W, 3), RGB.

    Raises:
        ConfigError: It is not an image.
    """
    image = cv2.imread(path, cv2.IMREAD_COLOR)
    if image is None:
        raise ConfigError(f"background.image={path}: not a readable image")
    return np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2RGB), np.uint8)
