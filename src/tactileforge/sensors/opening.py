"""Opening of sensors: built from their configuration, opened together."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from typing import Any, NamedTuple

from tactileforge.contracts import Sensor
from tactileforge.errors import ConfigError, SensorError, TactileForgeError, unknown
from tactileforge.plugins import registry
from tactileforge.sensors.awake import AWAKE_CLOCK

#: Longest time for a driver to open a device, and to close it, s.
_OPEN, _CLOSE = 30.0, 5.0
#: Seconds between looks at a running call of a driver.
_LOOK = 0.5
#: Start of the names of threads for calls of drivers.
_DRIVER = "driver-"


class BuiltSensors(NamedTuple):
    """Sensors before opening.

    Attributes:
        touch: Cameras and arrays, by name.
        force: Wrench sensor; None for none.
        camera: Camera with a view of the scene; None for none.
        robot: Source of state and actions; None for none.
    """

    touch: dict[str, Sensor]
    force: Sensor | None
    camera: Sensor | None
    robot: Sensor | None


def build_sensors(config: Mapping[str, Any]) -> BuiltSensors:
    """Build the sensors of a configuration, by its groups.

    Raises:
        ConfigError: A node names no plugin, or a driver does not take its options.
        PluginError: A plugin is not installed.
    """
    nodes: dict[str, Any] = {key: node for key, node in config["sensor"].items() if node}
    for key, node in nodes.items():
        if "name" not in node:
            raise ConfigError(unknown("sensor", key, registry.names("sensors")))
    sensors = {key: _built(f"sensor.{key}", node) for key, node in nodes.items()}
    others = {group: config.get(group) for group in ("force", "camera", "robot")}
    built = [_built(group, node) if node else None for group, node in others.items()]
    return BuiltSensors(sensors, *built)


def _built(key: str, node: Mapping[str, Any]) -> Sensor:
    try:
        sensor: Sensor = registry.build("sensors", node, key)
    except TactileForgeError:
        raise
    except Exception as error:  # a driver without an error of its own for it
        raise ConfigError(
            f"{key}: {node['name']} does not take its options: {type(error).__name__}: {error}"
        ) from error
    return sensor


def open_all(sensors: Mapping[str, Sensor], stack: ExitStack) -> None:
    """Open sensors; the stack closes them.

    Raises:
        SensorError: A sensor cannot be opened, or two are the same device.
        ConfigError: An option is missing or wrong.
    """
    owners: dict[str, str] = {}
    for name, sensor in sensors.items():
        # before open(), which may fail halfway and leave a device to close
        stack.callback(close_sensor, name, sensor)
        open_sensor(name, sensor)
        address = str(getattr(sensor, "address", ""))
        if address and address in owners:
            raise SensorError(
                f"{owners[address]} and {name} are one device, {address}: give each its own "
                "port, serial number or path"
            )
        owners[address] = name


def open_sensor(name: str, sensor: Sensor) -> None:
    """Open a sensor, whatever its driver does.

    Args:
        name: Name of the sensor, for messages.
        sensor: Sensor to open.

    Raises:
        SensorError: The sensor cannot be opened, or its driver does not return in time.
        ConfigError: An option is missing or wrong.

    Example:
        >>> from tactileforge.plugins import build
        >>> sensor = build("sensors", {"name": "sim", "size": 32, "realtime": False})
        >>> open_sensor("finger", sensor)
        >>> sensor.read().array.shape
        (32, 43, 3)
        >>> close_sensor("finger", sensor)
    """
    try:
        within(_OPEN, f"{name}: open()", sensor.open)
    except TactileForgeError:
        raise
    except OSError as error:  # a driver without an error of its own for it
        raise SensorError(f"{name}: cannot be opened: {error}") from error
    except Exception as error:
        raise SensorError(f"{name}: cannot be opened: {type(error).__name__}: {error}") from error


def close_sensor(name: str, sensor: Sensor) -> None:
    """Close a sensor, whatever its driver does.

    Args:
        name: Name of the sensor, for messages.
        sensor: Sensor to close.

    Raises:
        SensorError: The driver fails, or does not return in time.

    Example:
        >>> from tactileforge.plugins import build
        >>> close_sensor("finger", build("sensors", {"name": "sim_robot"}))
    """
    try:
        within(_CLOSE, f"{name}: close()", sensor.close)
    except TactileForgeError:
        raise
    except Exception as error:
        raise SensorError(
            f"{name}: close() of its driver fails with {type(error).__name__}: {error}; what was "
            "read is kept"
        ) from error


def unit_of(sensor: Sensor) -> str:
    """Serial number of an open sensor, or else its address; "" for a mere path.

    Paths such as ``/dev/video0`` name no unit: they change with the order of plugging in.
    """
    address = str(getattr(sensor, "address", ""))
    return str(getattr(sensor, "unit", "")) or ("" if address.startswith("/dev/") else address)


def is_driver_left() -> bool:
    """Whether a call left behind by `within` is still running."""
    return any(thread.name.startswith(_DRIVER) for thread in threading.enumerate())


def within(seconds: float, what: str, call: Callable[[], object]) -> None:
    """Call a driver in a thread of its own; a call over time is left behind.

    A thread, as a blocked call into a driver cannot be interrupted in any other way.

    Args:
        seconds: Longest time of the call, s.
        what: Name of the call, for messages.
        call: The call.

    Raises:
        SensorError: The call has not returned in time, or has tried to end the program.
        Exception: Error of the call.
    """
    ended: list[BaseException | None] = []

    def run() -> None:
        try:
            call()
            ended.append(None)
        except BaseException as error:  # SystemExit would end a thread in silence
            ended.append(error)

    thread = threading.Thread(target=run, name=f"{_DRIVER}{what}", daemon=True)
    AWAKE_CLOCK.start()
    end = AWAKE_CLOCK.now() + seconds
    thread.start()
    while thread.is_alive() and (left := end - AWAKE_CLOCK.now()) > 0:
        thread.join(min(left, _LOOK))
    if not ended:
        raise SensorError(
            f"{what} of its driver has not returned within {seconds:g} s and is left behind: plug "
            "the device out and in"
        )
    if isinstance(ended[0], Exception):
        raise ended[0]
    if ended[0] is not None:
        raise SensorError(f"{what} of its driver ends with {ended[0]!r}") from ended[0]
