"""Builds sensors from their configuration and opens them together."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import ExitStack
from typing import Any

from tactileforge import registry
from tactileforge.contracts import Sensor
from tactileforge.errors import ConfigError, SensorError, unknown


def build_sensors(
    config: Mapping[str, Any],
) -> tuple[dict[str, Sensor], Sensor | None, Sensor | None]:
    """Builds the sensors of a configuration, unopened: ``sensor`` by name, ``force``, ``camera``.

    Raises:
        ConfigError: A node names no plugin.
        PluginError: A plugin is not installed.
    """
    nodes: dict[str, Any] = {key: node for key, node in config["sensor"].items() if node}
    for key, node in nodes.items():
        if "name" not in node:
            raise ConfigError(unknown("sensor", key, registry.names("sensors")))
    sensors = {key: registry.build("sensors", node) for key, node in nodes.items()}
    others = [config.get(group) for group in ("force", "camera")]
    force, camera = (registry.build("sensors", node) if node else None for node in others)
    return sensors, force, camera


def open_all(sensors: Mapping[str, Sensor], stack: ExitStack) -> None:
    """Opens sensors; the stack closes them.

    Raises:
        SensorError: One cannot be opened, or two are the same device.
    """
    owners: dict[str, str] = {}
    for name, sensor in sensors.items():
        try:
            stack.enter_context(sensor)
        except OSError as error:  # a driver that has no words of its own for it
            raise SensorError(f"{name}: cannot be opened: {error}") from error
        address = str(getattr(sensor, "address", ""))
        if address and address in owners:
            raise SensorError(
                f"{owners[address]} and {name} are one device, {address}: give each its own "
                "port, serial number or path"
            )
        owners[address] = name
