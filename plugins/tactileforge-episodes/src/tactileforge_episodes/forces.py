"""Forces of an array in newton, along the axes of a map."""

from __future__ import annotations

from math import prod

import numpy as np
from numpy.typing import NDArray

from tactileforge.errors import DataError
from tactileforge_episodes.map_keys import ForceKeys
from tactileforge_episodes.refs import ArrayRef, numbers

#: Most numbers of a row of forces.
_WIDEST = 4096


def newtons(about: ForceKeys, where: str = "map: touch.force") -> float:
    """Newton of the unit of an array.

    Args:
        about: Its key, unit and signs.
        where: Place of the unit, for errors.

    Raises:
        ConfigError: The unit is unknown, or not stated where the key names one.
    """
    keys = (about.array,) if isinstance(about.array, str) else about.array
    return max(about.newtons([key] * 3, where) for key in keys)


def read_force(
    ref: ArrayRef, about: ForceKeys, rows: range, pad: int | None, limit: float | None
) -> NDArray[np.float32]:
    """Force of the rows, float32 (T, 3), N; NaN where it is not known; z is not turned.

    Args:
        ref: The array.
        about: Its columns, unit and signs.
        rows: The rows.
        pad: Index along the second axis of an array with pads; None for none.
        limit: Largest magnitude of a number; None for those of float32.

    Raises:
        DataError: The array has no such column.
    """
    wide = prod(ref.facts.shape[1:])
    if wide > _WIDEST:
        raise DataError(f"{ref}: {ref.facts.shape} has {wide} numbers a row, which are no force")
    values = numbers(ref.rows(rows, ahead=True), ref, limit)
    values = values[:, pad] if pad is not None and values.ndim == 3 else values
    # a simulator's forces of the bodies of one sensor, which are one
    values = values[:, 0] if values.ndim == 3 and values.shape[1] == 1 else values
    values = values[:, None] if values.ndim == 1 else values
    most = max((column for column in about.columns if column is not None), default=0)
    if values.ndim != 2 or values.shape[1] <= most:
        raise DataError(
            f"{ref}: {ref.facts.shape} has no column {most}; correct `force` in the map"
        )
    force = np.full((len(values), 3), np.nan, np.float32)
    for axis, (column, sign) in enumerate(zip(about.columns, about.sign, strict=True)):
        if column is not None:
            factor = 1.0 if sign == "mean" else float(sign)
            force[:, axis] = values[:, column].astype(np.float64) * (factor * newtons(about))
    return force
