"""Rows of an encoder's sensor table, by the names of sensors."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from typing import Any, Literal

import torch
from torch import Tensor

from tactileforge.errors import ConfigError, unknown

#: What to do with a sensor that the model never saw.
Policy = Literal["error", "universal"]


def takes_any_sensor(encoder: Any) -> bool:
    """Whether an encoder ignores the sensor type."""
    if not encoder.sensors:
        return True
    if not hasattr(encoder, "sensor_ids"):
        return False
    try:
        # asked by a name that no sensor has
        encoder.sensor_ids([""])
    except ConfigError:
        return False
    return True


def name_each(
    sensor: str | Sequence[str] | None, count: int, known: Sequence[str], any_sensor: bool
) -> list[str]:
    """Sensor name of each clip; "" where none is given and none is needed.

    Args:
        sensor: One name, one per clip, or None.
        count: GivenClips.
        known: Sensors that the encoder knows.
        any_sensor: Whether it ignores them.

    Raises:
        ConfigError: None is given where several are known, or another number than of clips.
    """
    if sensor is None and any_sensor:
        sensor = ""
    elif sensor is None:
        if len(known) > 1:
            raise ConfigError(f"no sensor is named: give sensor=..., one of: {', '.join(known)}")
        sensor = next(iter(known))
    names = [sensor] * count if isinstance(sensor, str) else list(sensor)
    if len(names) != count:
        raise ConfigError(f"{len(names)} sensors for {count} clips: one name, or one per clip")
    return names


def row_each(encoder: Any, names: Sequence[str], policy: Policy, any_sensor: bool) -> Tensor:
    """Rows of the sensor table, int64, one for each name.

    Args:
        encoder: The touch encoder.
        names: Names of the sensors, one per clip; see `name_each`.
        policy: Policy for a sensor without a row: ``error`` or ``universal``.
        any_sensor: Whether the encoder ignores sensors.

    Raises:
        ConfigError: A sensor has no row, and the policy is an error.
    """
    if policy not in ("error", "universal"):
        raise ConfigError(f"unknown_sensor={policy!r}: give error or universal")
    if any_sensor:
        # nobody looks at these rows
        return torch.zeros(len(names), dtype=torch.int64)
    known: dict[str, int] = encoder.sensors
    universal: int | None = getattr(encoder, "universal", None)
    if universal is not None:
        known = {"universal": universal, **known}
    strange = sorted({name for name in names if name not in known})
    if strange and (universal is None or policy == "error"):
        fix = "unknown_sensor='universal' takes the tokens that fit no sensor in particular."
        fix = "" if universal is None else fix
        raise ConfigError(unknown("sensor of the model", strange[0], known, fix))
    if strange:
        warnings.warn(
            f"the model never saw {', '.join(strange)}: it takes the universal sensor tokens, "
            "which are not meant for predicting force",
            stacklevel=5,
        )
    return torch.tensor([known.get(name, universal) for name in names])
