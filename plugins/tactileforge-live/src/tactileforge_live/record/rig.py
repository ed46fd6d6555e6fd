"""The sensors of a recording: opened together, each read in a thread, encoded on arrival."""

from __future__ import annotations

import logging
import time
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from dataclasses import dataclass, field
from functools import partial
from typing import Self

import numpy as np
from numpy.typing import NDArray
from tactileforge_depth.reader import depth_readers
from tactileforge_markers.track import MarkerTracker
from tactileforge_markers.tracks import check_marker_sensors

from tactileforge.checks import StreamChecks, background_lines
from tactileforge.contracts import Frame, Sensor
from tactileforge.errors import ConfigError, SensorError
from tactileforge.sensors import (
    AWAKE_CLOCK,
    Capture,
    check_background,
    check_captures,
    open_all,
    spread_frames,
)
from tactileforge.specs import spec
from tactileforge_live.record.frame_queue import FrameQueue, SampleBuffer
from tactileforge_live.record.options import RecordOptions

log = logging.getLogger(__name__)

#: Name and group of options of each kind of device without frames.
_GROUPS = {"wrench": ("wrench sensor", "force"), "robot": ("robot", "robot")}
#: Duration of frames waiting for the disk, beyond two segments, s.
_SLACK = 10.0
#: Time limit for the first frame or sample of every device, s.
_PATIENCE = 10.0
#: Rows of a stored height map; finer ones can be computed from the frames.
DEPTH_ROWS = 16
#: Largest number of frames for a background; more would only take memory.
_LOOKED_AT = 60


@dataclass
class RigSensor:
    """One sensor of a recording.

    Attributes:
        name: Name of the sensor, part of the keys of its recordings.
        sensor: Sensor, open inside of `Rig`.
        capture: Thread that reads the sensor.
        checks: Checks of its frames.
        keeps: Data of a take: `FrameQueue` for a camera or array, `SampleBuffer` for a wrench
            sensor or robot.
        background: Encoded frames without contact.
        rest: Wrench without contact, float64 (6,), N and N m.
        seen: Frames for the next background; None while no background is taken.
    """

    name: str
    sensor: Sensor
    capture: Capture = field(init=False)
    checks: StreamChecks = field(init=False)
    keeps: FrameQueue | SampleBuffer = field(init=False)
    background: list[bytes] = field(default_factory=list)
    rest: NDArray[np.float64] = field(default_factory=lambda: np.zeros(6))
    seen: list[Frame] | None = None

    def sink(self, frame: Frame) -> None:
        """Adds a frame; called in the sensor's thread."""
        seen = self.seen
        if seen is not None:
            seen.append(frame)
        self.keeps.take(frame)


class Rig:
    """Opens the sensors of a recording, reads them, and closes them.

    Args:
        sensors: Cameras and arrays, by name.
        force: Wrench sensor; None for none.
        camera: Camera for views of the scene; None for none.
        options: Options of the recording.
        robot: Robot, for its state and actions; None for none.

    Attributes:
        devices: Devices of ``sensors``.
        force: The wrench sensor, if any.
        camera: The camera for views, if any.
        robot: The robot, if any.

    Raises:
        ConfigError: There is no sensor, or one is of the wrong kind or an unknown type.
    """

    def __init__(
        self,
        sensors: Mapping[str, Sensor],
        force: Sensor | None,
        camera: Sensor | None,
        options: RecordOptions,
        robot: Sensor | None = None,
    ) -> None:
        self.options = options
        if not sensors:
            raise ConfigError("no sensor: choose some, e.g. sensor=[digit,gelsight_mini]")
        for name, sensor in sensors.items():
            if sensor.spec.kind in _GROUPS:
                what, group = _GROUPS[sensor.spec.kind]
                raise ConfigError(f"{name} is a {what}: choose it with {group}={name}")
            spec(sensor.spec.name)  # raises for an unknown type, whose recordings could not be read
        if force is not None and force.spec.kind != "wrench":
            raise ConfigError(
                f"force={force.spec.name} is not a wrench sensor: choose it as sensor="
            )
        if camera is not None and camera.spec.kind != "image":
            raise ConfigError(f"camera={camera.spec.name} is not a camera")
        if robot is not None and (robot.spec.kind != "robot" or robot.spec.states < 1):
            raise ConfigError(f"robot={robot.spec.name} is no robot: choose it as sensor=")
        self.devices = [RigSensor(name, sensor) for name, sensor in sensors.items()]
        self.force = None if force is None else RigSensor("force", force)
        self.camera = None if camera is None else RigSensor("view", camera)
        self.robot = None if robot is None else RigSensor("robot", robot)
        if taken := sensors.keys() & {"force", "view", "robot"}:
            raise ConfigError(f"no sensor can be called {taken.pop()}: choose another name for it")
        check_marker_sensors(options.markers, sensors)
        self._depth = depth_readers(options.depth, sensors, DEPTH_ROWS)
        self._stack = ExitStack()

    @property
    def all(self) -> list[RigSensor]:
        """All devices."""
        return [
            *self.devices,
            *(d for d in (self.force, self.camera, self.robot) if d is not None),
        ]

    def codec(self, device: RigSensor) -> str:
        """Codec of the frames of a device."""
        return "png" if device.sensor.spec.kind == "array" else self.options.codec

    def __enter__(self) -> Self:
        """Opens all sensors and starts reading them.

        Raises:
            SensorError: A sensor cannot be opened, or two are the same device.
        """
        options = self.options
        with ExitStack() as stack:
            pool = stack.enter_context(ThreadPoolExecutor(options.workers, "encode"))
            open_all({device.name: device.sensor for device in self.all}, stack)
            for device in self.all:
                device.keeps = self._keeper(device, pool)
                if device.name in options.markers and isinstance(device.keeps, FrameQueue):
                    device.keeps.in_order = stack.enter_context(ThreadPoolExecutor(1, "markers"))
                device.checks = StreamChecks(device.name, device.sensor.spec, options.ignore)
                device.capture = Capture(
                    device.name,
                    device.sensor,
                    device.sink,
                    options.reconnect,
                    checks=device.checks,
                )
                stack.callback(device.capture.stop)
                device.capture.start()
            # all is open: `__exit__` closes it, where an error above would have closed what was
            self._stack = stack.pop_all()
        return self

    def _keeper(self, device: RigSensor, pool: ThreadPoolExecutor) -> FrameQueue | SampleBuffer:
        # two segments: one is written while the next one comes
        hold = int(device.sensor.spec.fps * (2 * self.options.segment + _SLACK)) + 1
        if device is self.force:
            return SampleBuffer(hold)
        if device is self.robot:
            return SampleBuffer(hold, device.sensor.spec.states + device.sensor.spec.actions)
        codecs = {self.codec(device)}
        if device is self.camera:
            # its views go into the recording of each sensor, in the codec of that one
            codecs = {self.codec(device) for device in self.devices}
        return FrameQueue(pool, sorted(codecs), self.options.quality, self.options.queue, hold)

    def __exit__(self, *error: object) -> None:
        self._stack.close()

    def check(self) -> None:
        """Raises the error of the first failed device."""
        check_captures([device.capture for device in self.all])

    @property
    def is_over(self) -> bool:
        """Whether no sensor will deliver further frames."""
        return all(device.capture.is_done for device in self.devices)

    def take_background(self) -> None:
        """Takes frames without contact, and the wrench without load.

        Raises:
            SensorError: Something touches a sensor, or a sensor delivers nothing.
        """
        given = self.options.background
        self._wait_for_all()
        for device in self.all:
            device.seen = []
        end = time.monotonic() + given.seconds
        while time.monotonic() < end:
            time.sleep(0.02)
            self.check()
        for device in self.devices:
            seen, device.seen = device.seen or [], None
            device.background = []
            if given.seconds:
                step = -(-len(seen) // _LOOKED_AT) or 1  # rounded up
                frames = [frame.array for frame in seen[::step]]
                camera = device.sensor.spec.kind == "image"
                good = check_background(device.name, frames, given.threshold, camera)
                codec, keeps = self.codec(device), device.keeps
                assert isinstance(keeps, FrameQueue)
                chosen = spread_frames(good, given.frames)
                device.background = [keeps.encode(frame)[codec] for frame in chosen]
                still = np.median(chosen, axis=0).astype(np.uint8)
                for line in background_lines(still, device.sensor.spec.name) if camera else ():
                    log.warning("%s: %s", device.name, line)
                if device.name in self.options.markers:
                    keeps.tracker = MarkerTracker(still, f"the background of {device.name}")
                if device.name in self._depth:
                    keeps.measure = partial(self._depth[device.name].micrometres, background=still)
        for other in (self.camera, self.robot):
            if other is not None:
                other.seen = None
        if self.force is not None:
            self._tare(self.force)

    def _wait_for_all(self) -> None:
        """Waits until every device has delivered a frame or sample."""
        end = AWAKE_CLOCK.now() + _PATIENCE
        while silent := [d for d in self.all if not (d.capture.is_done or d.capture.has_begun)]:
            self.check()
            if AWAKE_CLOCK.now() > end:
                why = silent[0].capture.cause or "is it on?"
                raise SensorError(f"{silent[0].name}: gives nothing within {_PATIENCE:g} s; {why}")
            time.sleep(0.02)

    def _tare(self, force: RigSensor) -> None:
        seen, force.seen = force.seen or [], None
        wrenches = [frame.raw for frame in seen if frame.raw is not None]
        if self.options.background.seconds and not wrenches:
            raise SensorError(f"{force.name}: no wrench came without load; does it still run?")
        if self.options.tare and wrenches:
            force.rest = np.mean(wrenches, axis=0, dtype=np.float64)

    def start(self, time: float, end: float) -> None:
        """Starts keeping frames and samples from ``time`` to before ``end``, monotonic s."""
        for device in self.all:
            device.keeps.start(time, end)

    def stop(self) -> None:
        """Stops keeping frames and samples."""
        for device in self.all:
            device.keeps.stop()

    def has_passed(self, time: float) -> bool:
        """Whether all frames and samples before a time have arrived; lost devices do not count."""
        waits = [d for d in self.all if not (d.capture.is_done or d.capture.is_lost)]
        return all(device.capture.latest >= time for device in waits)
