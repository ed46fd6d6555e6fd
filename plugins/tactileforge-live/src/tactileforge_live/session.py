"""Live session: estimates contact, force and slip from the newest frame of each sensor."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field

import numpy as np
from tactileforge_depth.reader import depth_readers
from tactileforge_markers.tracks import check_marker_sensors

from tactileforge.contracts import Sensor
from tactileforge.errors import ConfigError, SensorError, unknown
from tactileforge.hub import Model
from tactileforge.sensors import (
    AWAKE_CLOCK,
    TROUBLES,
    Background,
    check_captures,
    load_calibration,
    low_latency_threads,
    open_all,
    unit_of,
)
from tactileforge_live.publish import Publisher
from tactileforge_live.sensor_stream import Reading, SensorStream, StreamOptions, read_background

#: Time limit for the first frame of every sensor, and longest wait of the loop for a frame, s.
_PATIENCE, _WAIT = 10.0, 0.1
#: Numbers of readings for percentiles of latency: at the end, and during the session.
_KEPT, _RECENT = 20_000, 300
#: Rows of a height map, few enough for a computation in milliseconds.
LIVE_ROWS = 60


@dataclass(frozen=True, kw_only=True)
class ShowBackground(Background):
    """Options of the background, the frame without contact.

    Attributes:
        seconds: Duration of taking it at the start, s; 0 takes the first frame, unchecked.
        image: File of the background, instead of taking it; "" for none.
    """

    image: str = ""


@dataclass(frozen=True, kw_only=True)
class LiveOptions(StreamOptions):
    """Options of a live session.

    Attributes:
        background: Options of the frame without contact.
        calibration: Files of `tactileforge calibrate model=...` for forces, by sensor.
        depth: Optical calibrations for depth, by sensor: a shipped name or a file, as in
            {digit: digit}. Shipped ones are of a different unit, so depths are estimates.
        markers: Sensors whose gels have printed dots, as in [gelsight_mini], for their
            displacement, shear and torsion.
        seconds: Duration of the session, s; None until stopped.
        frames: Number of readings after which it ends; None until stopped.
    """

    background: ShowBackground = field(default_factory=ShowBackground)
    calibration: Mapping[str, str] = field(default_factory=dict)
    depth: Mapping[str, str] = field(default_factory=dict)
    markers: tuple[str, ...] = ()
    seconds: float | None = None
    frames: int | None = None

    def __post_init__(self) -> None:
        for name in ("seconds", "frames"):
            value = getattr(self, name)
            if value is not None and not value > 0:
                raise ConfigError(f"{name}={value}: give a value above 0")


class Latency:
    """Statistics of the latency from frame to reading."""

    def __init__(self) -> None:
        self._all: deque[float] = deque(maxlen=_KEPT)

    def add(self, seconds: float) -> None:
        """Adds one latency, s."""
        self._all.append(seconds)

    def percentiles(self, recent: bool = True) -> tuple[float, float]:
        """Computes p50 and p99, s, of the latest or of all latencies; NaN without any."""
        values = list(self._all)[-_RECENT if recent else 0 :]
        if not values:
            return float("nan"), float("nan")
        p50, p99 = np.percentile(values, [50, 99])
        return float(p50), float(p99)


class LiveSession:
    """Opens sensors, takes their backgrounds, and computes readings until stopped.

    Args:
        sensors: Cameras and arrays by name, not open.
        model: Model for vectors and forces; None for contact alone.
        options: Options of the session; None for the defaults.

    Attributes:
        fingers: Streams of the sensors by name, while the session is open.
        latency: Latency of readings.

    Raises:
        ConfigError: There is no sensor, or one without images.

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
        """Opens all sensors and starts reading them.

        Raises:
            SensorError: A sensor cannot be opened or gives no frames, or two are the same device.
            ConfigError: The model does not know a sensor, or a calibration is of a different one.
        """
        options = self.options
        # files and names first: a device is opened only where they are right
        if strange := sorted(set(options.calibration) - set(self.sensors)):
            raise ConfigError(unknown("sensor of calibration", strange[0], self.sensors))
        known = {name: load_calibration(path) for name, path in options.calibration.items()}
        check_marker_sensors(options.markers, self.sensors)
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
                    name in options.markers,
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

    def _wait_for_all(self) -> None:
        end = AWAKE_CLOCK.now() + _PATIENCE
        while silent := [f for f in self.fingers.values() if not f.stream.buffer.count]:
            self.check()
            if AWAKE_CLOCK.now() > end or silent[0].capture.ended:
                why = silent[0].capture.cause or "is it on?"
                raise SensorError(f"{silent[0].name}: delivers no frames; {why}")
            time.sleep(0.01)

    def check(self) -> None:
        """Raises the error of the first failed sensor."""
        check_captures([finger.capture for finger in self.fingers.values()])

    def take_background(self) -> None:
        """Takes the background of every sensor, without contact meanwhile.

        Raises:
            SensorError: Something touches, or a sensor delivers no valid image.
            DataError: The background shows no markers, where they are asked for.
            ConfigError: The size of the given image does not match the frames.
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
        """Yields readings of the newest frames on arrival, and None at intervals without a frame.

        Args:
            stop: Event to end the session; None for none.

        Raises:
            SensorError: A sensor was lost and did not come back.
        """
        fingers, options = list(self.fingers.values()), self.options
        end = float("inf") if options.seconds is None else time.monotonic() + options.seconds
        count = 0
        while not (stop is not None and stop.is_set()) and time.monotonic() < end:
            self.check()
            if all(f.capture.ended and not f.stream.is_fresh for f in fingers):
                return
            # not for ever: a lost sensor wakes nobody, and nor does `stop`
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
        view: Open session.
        publishers: Publishers of readings and events.
        stop: Event to end the session; None for none.
        say: Function for messages to the user, one line each.
        tell: Function called after each reading, to show the status; None for none.

    Raises:
        SensorError: The background cannot be taken, or a sensor was lost, see
            `LiveSession.take_background` and `LiveSession.readings`.
    """
    if view.options.background.seconds and not view.options.background.image:
        say("background: nothing may touch the sensors now")
    view.take_background()
    states = dict.fromkeys(view.fingers, "")
    told: set[tuple[str, str]] = set()
    with ExitStack() as stack:
        for publisher in publishers:
            publisher.open()
            stack.callback(publisher.close)
        for reading in view.readings(stop):
            messages = [] if reading is None else [reading.message()]
            for name, finger in view.fingers.items():
                found = dict(finger.checks.found)  # copied, as the sensor's thread adds to it
                # those of TROUBLES are states, which are told whenever they change
                new = [key for key in found if key not in TROUBLES and (name, key) not in told]
                told.update((name, key) for key in new)
                if (state := finger.state) != states[name]:
                    states[name] = state
                    new.append(state or "good")
                for key in new:
                    finding = found.get(key)
                    event = {"sensor": name, "event": key, "time": time.monotonic()}
                    if finding is not None:
                        event["code"] = finding.code
                    say(str(finding or f"{name}: {key if key != 'good' else 'all is well again'}"))
                    messages.append(event)
            for message in messages:
                for publisher in publishers:
                    publisher.send(message)
            if tell is not None:
                tell(view)
    check_captures([finger.capture for finger in view.fingers.values()], at_end=True)
