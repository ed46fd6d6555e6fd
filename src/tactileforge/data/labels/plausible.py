"""Implausible labels: slips of units, of columns and of exponents."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from tactileforge.contracts import Recording
from tactileforge.errors import ConfigError
from tactileforge.specs.published import spec

#: Largest possible force, as a multiple of the sensor's scale: its gel would be long torn.
_TIMES = 100.0
#: Scale of an unknown sensor, N.
_SCALE = (10.0, 10.0, 10.0)
#: Largest number of float32, the type of training.
_LARGEST = float(np.finfo(np.float32).max)


def limits(sensor: str) -> tuple[float, float, float]:
    """Largest possible forces of a sensor, N by axis.

    Example:
        >>> limits("digit")
        (525.0, 1061.0, 1414.0)
    """
    try:
        scale = spec(sensor).force_scale
    except ConfigError:
        scale = _SCALE
    x, y, z = (round(_TIMES * axis, 6) for axis in scale)
    return x, y, z


def impossible_row(force: ArrayLike, sensor: str) -> int | None:
    """First row of impossible forces, (T, 3); None without one.

    NaN stands for a missing label, and is not impossible.
    """
    beyond = np.abs(np.asarray(force, np.float64)) > np.array(limits(sensor))
    rows = np.flatnonzero(beyond.any(axis=-1))
    return int(rows[0]) if len(rows) else None


def impossible(recording: Recording) -> str:
    """Describe an impossible label of a recording in one line; "" without one.

    An impossible label is a force beyond `limits`, or any number beyond float32.
    """
    if recording.force is not None:
        row = impossible_row(recording.force, recording.sensor)
        if row is not None:
            felt = ", ".join(f"{axis:g}" for axis in recording.force[row])
            most = ", ".join(f"{axis:g}" for axis in limits(recording.sensor))
            return (
                f"{recording.key}, row {row}: a force of ({felt}) N, where {recording.sensor} "
                f"can feel ({most}) N at most; say its unit (unit: of force in a layout), or "
                "correct it"
            )
    for name, value in recording.labels.items():
        if not isinstance(value, str) and abs(value) > _LARGEST:
            return f"{recording.key}: {name} is {value:g}, more than float32 holds; correct it"
    for name, values in recording.tracks.items():
        if values.dtype.kind == "f":
            rows = np.flatnonzero((np.abs(values) > _LARGEST).reshape(len(values), -1).any(1))
            if len(rows):
                return (
                    f"{recording.key}, row {rows[0]}: {name} is {np.max(np.abs(values[rows[0]])):g}"
                    ", more than float32 holds; correct it"
                )
    return ""
