"""Forces of an array in newton, along the axes of a map."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tactileforge.plugin import DataError
from tactileforge_episodes.map_keys import ForceKeys
from tactileforge_episodes.refs import ArrayRef, numbers

#: Newton of each unit.
_NEWTON = {"N": 1.0, "mN": 1e-3, "kgf": 9.80665, "gf": 9.80665e-3}


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
    values = numbers(ref.rows(rows, ahead=True), ref, limit)
    values = values[:, pad] if pad is not None and values.ndim == 3 else values
    most = max((column for column in about.columns if column is not None), default=0)
    if values.ndim != 2 or values.shape[1] <= most:
        raise DataError(
            f"{ref}: {ref.facts.shape} has no column {most}; correct `force` in the map"
        )
    force = np.full((len(values), 3), np.nan, np.float32)
    for axis, (column, sign) in enumerate(zip(about.columns, about.sign, strict=True)):
        if column is not None:
            factor = 1.0 if sign == "mean" else float(sign)
            force[:, axis] = values[:, column].astype(np.float64) * (factor * _NEWTON[about.unit])
    return force
