"""Live session: estimates contact, force and slip from the newest frame of each sensor."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field

import numpy as np

from tactileforge.calibration.file import Calibration, load_calibration
from tactileforge.contracts import Sensor
from tactileforge.depth import depth_readers
from tactileforge.errors import ConfigError, SensorError, unknown
from tactileforge.hub.model import Model
from tactileforge.live.publish import Publisher
from tactileforge.live.sensor_stream import Reading, SensorStream, StreamOptions, read_background
from tactileforge.sensors.awake import CLOCK
from tactileforge.sensors.background import Background
from tactileforge.sensors.capture import check
from tactileforge.sensors.low_latency_threads import low_latency_threads
from tactileforge.sensors.opening import open_all, unit_of

#: Seconds in which every sensor must begin to send; and that the loop waits for a frame.
_PATIENCE, _WAIT = 10.0, 0.1
#: Readings over which latency is told: of the whole run at the end, and meanwhile.
_KEPT, _RECENT = 20_000, 300
#: Largest number of a port.
_LAST_PORT = 65535
#: Rows of a height map: few, so that a frame takes milliseconds.
LIVE_ROWS = 60


def check_port(port: int) -> None:
    """Checks the number of the page's port.

    Raises:
        ConfigError: There is no such port.
    """
    if not 0 <= port <= _LAST_PORT:
        raise ConfigError(f"port={port}: give 1 to {_LAST_PORT}, or 0 for any that is free")


@dataclass(frozen=True, kw_only=True)
class ShowBackground(Background):
    """The frame without contact.

    Attributes:
        seconds: For how long it is taken at the start; 0 takes the first frame, unchecked.
        image: File of it instead; "" takes it.
    """

    image: str = ""


@dataclass(frozen=True, kw_only=True)
class LiveOptions(StreamOptions):
    """Options of a live session.

    Attributes:
        background: How the frame without contact is taken.
        calibration: Files of `tactileforge calibrate model=...`, by sensor, for its forces.
        depth: Optical calibrations, by sensor, for its depth: a name that ships, or a file, as in
            {digit: digit}. Those that ship are of another unit, so sizes are estimates.
        seconds: After which it ends; None until stopped.
        frames: Readings after which it ends; None until stopped.
    """

    background: ShowBackground = field(default_factory=ShowBackground)
    calibration: Mapping[str, str] = field(default_factory=dict)
    depth: Mapping[str, str] = field(default_factory=dict)
    seconds: float | None = None
    frames: int | None = None

    def __post_init__(self) -> None:
        for name in ("seconds", "frames"):
            value = getattr(self, name)
            if value is not None and not value > 0:
                raise ConfigError(f"{name}={value}: give a value above 0")


class Latency:
    """Seconds from frame to reading."""

    def __init__(self) -> None:
        self._all: deque[float] = deque(maxlen=_KEPT)

    def add(self, seconds: float) -> None:
        """Adds one latency, s."""
        self._all.append(seconds)

    def percentiles(self, recent: bool = True) -> tuple[float, float]:
        """p50 and p99, s, of the latest or of all latencies; NaN without any."""
        values = list(self._all)[-_RECENT if recent else 0 :]
        if not values:
            return float("nan"), float("nan")
        p50, p99 = np.percentile(values, [50, 99])
        return float(p50), float(p99)


class LiveSession:
    """Opens sensors, takes their backgrounds, and computes readings until stopped.

    Args:
        sensors: Cameras and arrays by name, not open.
        model: From which vectors and forces come; None for contact alone.
        options: How.

    Attributes:
        fingers: By name, while it is open.
        latency: Of all readings.

    Raises:
        ConfigError: No sensor, or one of the wrong kind.

    Example:
        >>> with LiveSession({"digit": sensor}, model) as show:  # doctest: +SKIP
        ...     for reading in show.readings():
        ...         print(reading.force, reading.contact)
    """

    def __init__(
        self,
        sensors: Mapping[str, Sensor],
        model: Model | None = None,
        options: LiveOptions | None = None,
    ) -> None:
        if not sensors:
            raise ConfigError("no sensor: choose some, e.g. sensor=digit")
        for name, sensor in sensors.items():
            if sensor.spec.kind in ("wrench", "robot"):
                raise ConfigError(f"{name} ({sensor.spec.kind}) has no images to show")
        self.sensors, self.model = dict(sensors), model
        self.options = options or LiveOptions()
        self.fingers: dict[str, SensorStream] = {}
        self.latency = Latency()
        self.wake = threading.Condition()
        self._stack = ExitStack()

    def __enter__(self) -> LiveSession:
        """Opens all sensors, and starts to read them.

        Raises:
            SensorError: One cannot be opened, gives nothing, or two are the same device.
            ConfigError: The model does not know one, or a calibration is of another.
        """
        options, known = self.options, self._calibrations()
        depth = depth_readers(options.depth, self.sensors, LIVE_ROWS)
        with ExitStack() as stack:
            stack.enter_context(low_latency_threads())
            open_all(self.sensors, stack)
            for name, calibration in known.items():
                calibration.check(self.sensors[name].spec.name, unit_of(self.sensors[name]))
            self.fingers = {
                name: SensorStream(
                    name,
                    sensor,
                    self.model,
                    self.wake,
                    options,
                    known.get(name),
                    depth.get(name),
                )
                for name, sensor in self.sensors.items()
            }
            for finger in self.fingers.values():
                stack.callback(finger.capture.stop)
                finger.capture.start()
            self._wait_for_all()
            self._stack = stack.pop_all()
        return self

    def __exit__(self, *error: object) -> None:
        self._stack.close()

    def _calibrations(self) -> dict[str, Calibration]:
        paths = self.options.calibration
        if strange := sorted(set(paths) - set(self.sensors)):
            raise ConfigError(unknown("sensor of calibration", strange[0], self.sensors))
        return {name: load_calibration(path) for name, path in paths.items()}

    def _wait_for_all(self) -> None:
        end = CLOCK.now() + _PATIENCE
        while silent := [f for f in self.fingers.values() if not f.stream.buffer.count]:
            self.check()
            if CLOCK.now() > end or silent[0].capture.ended:
                why = silent[0].capture.cause or "is it on?"
                raise SensorError(f"{silent[0].name}: delivers no frames; {why}")
            time.sleep(0.01)

    def check(self) -> None:
        """Raises the error of the first sensor that has ended with one."""
        check([finger.capture for finger in self.fingers.values()])

    def take_background(self) -> None:
        """Takes the background of every sensor; nothing may touch it meanwhile.

        Raises:
            SensorError: Something touches, or a sensor delivers no valid image.
            ConfigError: The image given instead does not fit.
        """
        background = self.options.background
        image = read_background(background.image) if background.image else None
        for finger in self.fingers.values():
            finger.stream.begin_background()
        end = time.monotonic() + (0.0 if background.image else background.seconds)
        while time.monotonic() < end:
            time.sleep(0.02)
            self.check()
        for finger in self.fingers.values():
            finger.take_background(background, image)

    def readings(self, stop: threading.Event | None = None) -> Iterator[Reading | None]:
        """Readings of the newest frames as they arrive; None at intervals while none arrives.

        Args:
            stop: Ends them when set.

        Raises:
            SensorError: A sensor is lost, and has not come back.
        """
        fingers, options = list(self.fingers.values()), self.options
        end = float("inf") if options.seconds is None else time.monotonic() + options.seconds
        count = 0
        while not (stop is not None and stop.is_set()) and time.monotonic() < end:
            self.check()
            if all(f.capture.ended and not f.stream.is_fresh for f in fingers):
                return
            with self.wake:
                self.wake.wait_for(lambda: any(f.stream.is_fresh for f in fingers), _WAIT)
            batch = [finger.read() for finger in fingers]
            for reading in batch:
                if reading is not None:
                    self.latency.add(reading.latency)
                    yield reading
                    count += 1
                    if options.frames is not None and count >= options.frames:
                        return
            if not any(batch):
                yield None


def run_session(
    view: LiveSession,
    publishers: Sequence[Publisher] = (),
    stop: threading.Event | None = None,
    say: Callable[[str], None] = print,
    tell: Callable[[LiveSession], None] | None = None,
) -> None:
    """Takes the background, then publishes readings and the states of the sensors.

    Args:
        view: Open.
        publishers: Where readings and events go.
        stop: Ends it when set.
        say: Is told what happens, a line at a time.
        tell: Is called after each reading, to show how it goes.

    Raises:
        SensorError: See `LiveSession.take_background` and `LiveSession.readings`.
    """
    if view.options.background.seconds and not view.options.background.image:
        say("background: nothing may touch the sensors now")
    view.take_background()
    states = dict.fromkeys(view.fingers, "")
    with _opened(publishers):
        for reading in view.readings(stop):
            messages = [] if reading is None else [reading.message()]
            for name, finger in view.fingers.items():
                if (state := finger.state) != states[name]:
                    states[name] = state
                    say(f"{name}: {state or 'all is well again'}")
                    event = {"sensor": name, "event": state or "good", "time": time.monotonic()}
                    messages.append(event)
            for message in messages:
                for publisher in publishers:
                    publisher.send(message)
            if tell is not None:
                tell(view)
    check([finger.capture for finger in view.fingers.values()], at_end=True)


@contextmanager
def _opened(publishers: Sequence[Publisher]) -> Iterator[None]:
    with ExitStack() as stack:
        for publisher in publishers:
            publisher.open()
            stack.callback(publisher.close)
        yield
