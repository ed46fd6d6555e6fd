"""Labels that cannot be true: slips of units, of columns and of exponents."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tactileforge.contracts import Recording
from tactileforge.errors import ConfigError
from tactileforge.sensors.specs import spec

#: How many times the scale of a sensor a force may be: its gel would be long torn.
_TIMES = 100.0
#: Scale where a sensor is not known, N.
_SCALE = (10.0, 10.0, 10.0)
#: The largest number of float32, in which all is trained.
_LARGEST = float(np.finfo(np.float32).max)


def limits(sensor: str) -> tuple[float, float, float]:
    """The largest forces that a sensor can have felt, N by axis.

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
    """The first row of forces, (T, 3), that cannot be true; None where all can.

    NaN says that there is no label, and is none of them.
    """
    beyond = np.abs(np.asarray(force, np.float64)) > np.array(limits(sensor))
    rows = np.flatnonzero(beyond.any(axis=-1))
    return int(rows[0]) if len(rows) else None


def impossible(recording: Recording) -> str:
    """Names an impossible label of a recording in one line; "" where there is none.

    That is a force that its sensor cannot have felt, or any number that float32 has no place for.
    """
    if recording.force is not None:
        row = impossible_row(recording.force, recording.sensor)
        if row is not None:
            return _force(recording, recording.force, row)
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


def _force(recording: Recording, force: NDArray[np.floating], row: int) -> str:
    said = ", ".join(f"{axis:g}" for axis in force[row])
    most = ", ".join(f"{axis:g}" for axis in limits(recording.sensor))
    return (
        f"{recording.key}, row {row}: a force of ({said}) N, where {recording.sensor} can feel "
        f"({most}) N at most; correct its units"
    )
