"""Heads of a published file, beside its imported encoder."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import torch
from torch import nn

from tactileforge.errors import ConfigError, check_names, unknown
from tactileforge.hub import fill_weights
from tactileforge.plugins import registry
from tactileforge_published import Converted

#: Sensor of a force head -> columns and signs that turn (Fx, Fy, -Fz) of ToucHD into the axes of
#: `contracts`, and the newton along those that count as 1: ToucHD Bench divides by the largest
#: |Fx|, |Fy|, |Fz|, which are 5.25, 10.61, 14.14 (DIGIT) and 6.84, 9.87, 8.52 (GelSight Mini).
_FORCE: dict[str, tuple[list[int], list[float], list[float]]] = {
    "digit": ([0, 1, 2], [-1.0, 1.0, 1.0], [5.25, 10.61, 14.14]),
    "gelsight_mini": ([1, 0, 2], [1.0, 1.0, 1.0], [9.87, 6.84, 8.52]),
}
#: The one sensor of FeelAnyForce, and the largest force in its paper, N.
_MINI, _MINI_NEWTON = "gelsight_mini", 15.0
#: Words in the names of the published files.
_WORDS = {"digit": "digit", "gelsight": "gelsight_mini"}


def published_heads(
    converted: Converted, encoder: nn.Module, source: Path, sensor: str = ""
) -> tuple[dict[str, nn.Module], dict[str, Any]]:
    """The heads of a published file, and their entries of the header.

    Args:
        converted: The file.
        encoder: Imported encoder of the file.
        source: Path of the file: the names of the published files tell the sensor.
        sensor: Sensor of the force head's training; "" takes it from the name of the file.

    Returns:
        By name: ``force``, and ``classes`` for the heads that name materials.

    Raises:
        ConfigError: Nothing says on which sensor forces were trained.
        DataError: A head is not whole.
    """
    entries: dict[str, Any] = {}
    states = {}
    if converted.head is not None:
        entries["force"] = _force(converted.name, source, sensor)
        states["force"] = {f"decoder.{key}": x for key, x in converted.head.items()}
    if converted.probe is not None:
        name = "published_probe" if "pooler.queries" in converted.probe else "classify"
        count = len(converted.probe["linear.weight"])
        entries["classes"] = {"node": {"name": name, "classes": count}}
        states["classes"] = dict(converted.probe)
        if name == "classify":  # of its own classes, all of which it was trained on
            states["classes"]["met"] = torch.ones(count, dtype=torch.bool)
    heads = {}
    for name, entry in entries.items():
        heads[name] = registry.build("heads", entry["node"], encoder=encoder)
        fill_weights(heads[name], states[name], f"{source}, head {name}")
    return heads, entries


def _force(layout: str, source: Path, sensor: str) -> dict[str, Any]:
    """Entry of a force head: its plugin, and newton per unit of its output along each axis."""
    if layout == "feelanyforce":
        check_names("sensor of FeelAnyForce's forces", [sensor] if sensor else [], [_MINI])
        node = {"name": "published_regressor", "scale": _MINI_NEWTON}
        return {"node": node, "scale": {_MINI: [_MINI_NEWTON] * 3}}
    kind = _sensor(source, sensor)
    columns, signs, scale = _FORCE[kind]
    node = {"name": "published_force", "columns": columns, "signs": signs}
    return {"node": node, "scale": {kind: scale}}


def _sensor(source: Path, sensor: str) -> str:
    if not sensor:
        sensor = next((ours for word, ours in _WORDS.items() if word in source.name), "")
    if not sensor:
        raise ConfigError(
            f"{source} has a force head, and its name does not say for which sensor: give "
            f"sensor=, one of: {', '.join(_FORCE)}"
        )
    if sensor not in _FORCE:
        raise ConfigError(unknown("sensor of a published force head", sensor, _FORCE))
    return sensor
