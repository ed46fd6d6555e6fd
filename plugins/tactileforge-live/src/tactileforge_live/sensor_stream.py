"""Live estimates of one sensor from its frames and background."""

from __future__ import annotations

import threading
import time
from collections import deque
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray
from tactileforge_depth.reader import DepthReader
from tactileforge_markers.motion import Motion, marker_motion
from tactileforge_markers.track import MarkerTracker

from tactileforge.checks import StreamChecks
from tactileforge.contracts import Frame, Sensor
from tactileforge.data import rgb_pixels
from tactileforge.errors import ConfigError, DataError
from tactileforge.hub import Model
from tactileforge.plugins import open_picture
from tactileforge.sensors import (
    Background,
    Calibration,
    Capture,
    ContactOptions,
    Prediction,
    SlipOptions,
    TouchStream,
)

#: Number of readings kept for the page.
HISTORY = 512


@dataclass(frozen=True, kw_only=True)
class StreamOptions:
    """Options of one sensor in a live session.

    Attributes:
        contact: Thresholds of contact.
        slip: Thresholds of slip.
        embedding: Whether messages include the model's vector.
        force_unit: Unit of forces of sensors without a calibration: ``relative``, shares of the
            model's force scale, or ``uncalibrated``, newtons by that scale, an estimate. None for
            newtons of a model of your own recordings, else relative.
        unknown_sensor: Treatment of a sensor unknown to the model: ``error``, or the ``universal``
            tokens.
        reconnect: Time to wait for a lost sensor, s.
        ignore: Checks of the running sensors to leave out, by code: [TF603] (docs/checks.md).
    """

    contact: ContactOptions = field(default_factory=ContactOptions)
    slip: SlipOptions = field(default_factory=SlipOptions)
    embedding: bool = False
    force_unit: str | None = None
    unknown_sensor: str = "error"
    reconnect: float = 10.0
    ignore: tuple[str, ...] = ()


@dataclass(frozen=True, kw_only=True)
class Reading(Prediction):
    """A prediction with its sensor and latency.

    Attributes:
        sensor: Name of the sensor.
        latency: Seconds from the frame to this reading.
        depth: float32 (h, w), mm into the gel; None if depth is not requested or the image is
            invalid.
        markers: float32 (N, 2), displacement of markers, pixels; None if they are not followed or
            the image is invalid.
        motion: Motion of all markers together; None likewise.
    """

    sensor: str
    latency: float
    depth: NDArray[np.float32] | None = None
    markers: NDArray[np.float32] | None = None
    motion: Motion | None = None

    def message(self) -> dict[str, Any]:
        """The reading as plain data, for publishers."""
        message: dict[str, Any] = {
            "sensor": self.sensor,
            "frame": self.number,
            "time": round(self.time, 6),
            # monotonic time means nothing on another machine
            "unix": round(time.time() - time.monotonic() + self.time, 6),
            "force": None if self.force is None else [round(axis, 4) for axis in self.force],
            "force_unit": self.force_unit,
            "contact": self.contact,
            "slip": self.slip,
            "difference": round(self.difference, 2),
            "latency_ms": round(1000 * self.latency, 2),
        }
        if self.trouble:
            message["trouble"] = self.trouble
        if self.depth is not None:
            message["depth_mm"] = round(float(self.depth.max()), 3)
        if self.motion is not None:
            message |= self.motion.message()
        if self.embedding is not None:
            message["embedding"] = [float(f"{x:.5g}") for x in self.embedding]
        return message


class SensorStream:
    """A sensor read in a thread; readings of the newest frame are computed on request.

    Args:
        name: Name of the sensor.
        sensor: Open sensor.
        model: Model for vectors and forces; None for contact alone.
        wake: Condition notified on each new frame.
        options: Contact, slip, and the other options of a session.
        calibration: Calibration of this unit, for the model's forces; see `Model.force`. None for
            none.
        depth: Estimator of depth; None for none.
        markers: Whether to follow the gel's markers.

    Attributes:
        stream: Stream of predictions.
        checks: Checks of its frames.
        readings: Latest readings, at most `HISTORY`.
        tracker: Tracker of markers, from the background on; None without markers.

    Raises:
        ConfigError: The model does not know the sensor, the calibration is of a different one, or
            the model does not give forces in the unit of the options.
    """

    def __init__(
        self,
        name: str,
        sensor: Sensor,
        model: Model | None,
        wake: threading.Condition,
        options: StreamOptions,
        calibration: Calibration | None = None,
        depth: DepthReader | None = None,
        markers: bool = False,
    ) -> None:
        self._markers = markers
        self.tracker: MarkerTracker | None = None
        self.name, self.sensor, self.wake, self.depth = name, sensor, wake, depth
        self.stream = TouchStream(
            model,
            sensor.spec.name,
            contact=options.contact,
            slip=options.slip,
            embedding=options.embedding,
            unknown_sensor=options.unknown_sensor,
            calibration=calibration,
            # a unit that is asked for is that of the sensors without a calibration
            force_unit=None if calibration is not None else options.force_unit,
            camera=sensor.spec.kind == "image",
        )
        self.checks = StreamChecks(name, sensor.spec, options.ignore)
        self.capture = Capture(name, sensor, self.sink, options.reconnect, checks=self.checks)
        self.readings: deque[Reading] = deque(maxlen=HISTORY)
        self._frozen = 0

    def sink(self, frame: Frame) -> None:
        """Adds a frame; called in the sensor's thread."""
        self._frozen = self.capture.counts.frozen
        self.stream.add(frame)
        with self.wake:
            self.wake.notify()

    def take_background(self, options: Background, image: NDArray[np.uint8] | None) -> None:
        """Takes the background; see `TouchStream.take_background`.

        Raises:
            SensorError: Something touches, or there is no image.
            ConfigError: The image and the frames differ in size.
            DataError: The background shows no markers, where they are asked for.
        """
        spec = self.sensor.spec
        if image is not None and image.shape[:2] != (spec.height, spec.width):
            raise ConfigError(
                f"{self.name}: the background has {image.shape[:2]} pixels, and its frames "
                f"{(spec.height, spec.width)}"
            )
        self.stream.take_background(options, image, self.name)
        if self._markers and self.stream.background is not None:
            self.tracker = MarkerTracker(self.stream.background, f"the background of {self.name}")

    @property
    def state(self) -> str:
        """``lost``, ``frozen``, one of `health.TROUBLES`, or "" for a healthy sensor."""
        if self.capture.is_lost:
            return "lost"
        if self.capture.counts.frozen > self._frozen:
            return "frozen"
        return self.readings[-1].trouble if self.readings else ""

    def read(self) -> Reading | None:
        """Computes the reading of the newest frame; None without a new frame or a full clip."""
        prediction = self.stream.predict()
        if prediction is None:
            return None
        depth: NDArray[np.float32] | None = None
        moved = motion = None
        shown, still = self.stream.shown, self.stream.background
        if shown is not None and not prediction.trouble:
            is_alike = still is not None and shown.array.shape == still.shape
            if self.depth is not None and still is not None and is_alike:
                depth = self.depth.read(shown.array, still).depth.numpy()
            if self.tracker is not None:
                moved = self.tracker.read(shown.array)
                motion = marker_motion(self.tracker.grid.places, moved)
        # last, so that it has depth and markers in it
        latency = time.monotonic() - prediction.time
        reading = Reading(
            **vars(prediction),
            sensor=self.name,
            latency=latency,
            depth=depth,
            markers=moved,
            motion=motion,
        )
        self.readings.append(reading)
        return reading


def read_background(path: str) -> NDArray[np.uint8]:
    """Reads a background from a file, uint8 (H, W, 3), RGB.

    Raises:
        ConfigError: The file is not a readable RGB image of 8 bits per channel.
    """
    where = f"background.image={path}"
    try:
        with open_picture(path) as image:
            if len(image.getbands()) < 3 and image.mode not in ("P", "PA"):
                raise ConfigError(f"{where}: {image.mode} pixels; save it as RGB, 8 bits a channel")
            return rgb_pixels(image, where)
    except DataError as error:
        raise ConfigError(str(error)) from error
    except (OSError, SyntaxError, ValueError) as error:
        raise ConfigError(f"{where}: not a readable image ({error})") from error
