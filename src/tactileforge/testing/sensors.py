"""The checks of sensors. Checks of an open device are skipped if it cannot be opened."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

from tactileforge.contracts import Frame, Sensor, SensorSpec
from tactileforge.errors import TactileForgeError
from tactileforge.testing.results import Check, CheckSubject, Skip, Violation, require

#: Longest wait for a frame, s.
_TIMEOUT = 5.0


@contextmanager
def _opened(subject: CheckSubject) -> Iterator[Sensor]:
    sensor: Sensor = subject.build()
    try:
        sensor.open()
    except (OSError, ImportError, TactileForgeError) as error:
        if sensor.discover():  # it is there, so failing to open it is a fault
            raise
        raise Skip(f"it cannot be opened, and no device is found: {error}") from error
    try:
        yield sensor
    finally:
        sensor.close()


def _require_closed(sensor: Sensor, when: str) -> None:
    try:
        sensor.read(_TIMEOUT)
    except TactileForgeError:
        return
    except Exception as error:
        name = type(error).__name__
        raise Violation(f"read {when} raises {name}, not a TactileForgeError: {error}") from error
    raise Violation(f"read {when} gives a frame")


def spec_is_a_sensor_spec(subject: CheckSubject) -> None:
    """A sensor has a `SensorSpec` of its frames before it is opened."""
    sensor = subject.build()
    require(isinstance(sensor, Sensor), "it lacks a method or the attribute 'spec' of a Sensor")
    require(isinstance(sensor.spec, SensorSpec), f"spec is {sensor.spec!r}, not a SensorSpec")


def discover_with_nothing_attached_gives_nothing(subject: CheckSubject) -> None:
    """`discover` returns a list of addresses, empty without a device, and raises no error."""
    addresses = subject.build().discover()
    good = isinstance(addresses, list) and all(isinstance(address, str) for address in addresses)
    require(good, f"discover() gives {addresses!r}, not a list of addresses")
    if addresses:
        raise Skip(f"attached: {', '.join(addresses)}")


def read_before_open_raises(subject: CheckSubject) -> None:
    """Reading before `open` raises a `TactileForgeError`."""
    _require_closed(subject.build(), "before open")


def close_twice_does_nothing(subject: CheckSubject) -> None:
    """Closing a sensor twice raises no error, even if it was never open."""
    sensor = subject.build()
    sensor.close()
    sensor.close()


def frames_are_as_specified(subject: CheckSubject) -> None:
    """Frames are uint8 RGB of the spec's size, with the raw values of the spec's kind."""
    with _opened(subject) as sensor:
        frame = sensor.read(_TIMEOUT)
        require(isinstance(frame, Frame), f"read gives a {type(frame).__name__}, not a Frame")
        require(frame.array.dtype == np.uint8, f"frames are {frame.array.dtype}, not uint8")
        want = (sensor.spec.height, sensor.spec.width, 3)
        require(frame.array.shape == want, f"frames are {frame.array.shape}, its spec says {want}")
        _require_raw(frame, sensor.spec)


def _require_raw(frame: Frame, spec: SensorSpec) -> None:
    raw = frame.raw
    if spec.kind == "image":
        require(raw is None, "its kind is image, and its frames have raw values: is it an array?")
        return
    if raw is None:
        raise Violation(f"its kind is {spec.kind}, and its frames have no raw values")
    require(raw.dtype == np.float32, f"raw values are {raw.dtype}, not float32")
    require(bool(np.isfinite(raw).all()), f"raw values are not finite: {raw}")
    if spec.kind == "wrench":
        require((spec.height, spec.width) == (0, 0), "a wrench sensor has height and width 0")
        require(raw.shape == (6,), f"raw values are {raw.shape}: give (6,), in N and N m")
    elif spec.kind == "robot":
        require((spec.height, spec.width) == (0, 0), "a robot has height and width 0")
        want = (spec.states + spec.actions,)
        require(spec.states > 0, "its spec says states=0: a robot has a state")
        require(raw.shape == want, f"raw values are {raw.shape}: its spec says {want}")
    else:
        require(raw.ndim == 2, f"raw values are {raw.shape}: give (taxels, values of each)")


def time_strictly_increases(subject: CheckSubject) -> None:
    """Times of five frames strictly increase; a finite source may have fewer frames."""
    with _opened(subject) as sensor:
        times: list[float] = []
        try:
            for _ in range(5):
                times.append(sensor.read(_TIMEOUT).time)
        except EOFError:
            pass
        require(len(times) > 1, f"{len(times)} frame is too few to tell")
        require(all(np.diff(times) > 0), f"times are {times}")


def closes_for_good(subject: CheckSubject) -> None:
    """After close, read raises; a second close does nothing."""
    with _opened(subject) as sensor:
        sensor.close()
        sensor.close()
        _require_closed(sensor, "after close")


def closes_on_exception(subject: CheckSubject) -> None:
    """An exception in the ``with`` block of a sensor closes it and is passed on."""
    with _opened(subject) as sensor:  # skips the check where nothing is attached
        sensor.close()

    class Planned(Exception):
        pass

    sensor = subject.build()
    try:
        with sensor:
            sensor.read(_TIMEOUT)
            raise Planned
    except Planned:
        _require_closed(sensor, "after an exception in its with block")
        return
    raise Violation("an exception in its with block is swallowed")


CHECKS: list[Check] = [
    spec_is_a_sensor_spec,
    discover_with_nothing_attached_gives_nothing,
    read_before_open_raises,
    close_twice_does_nothing,
    frames_are_as_specified,
    time_strictly_increases,
    closes_for_good,
    closes_on_exception,
]
