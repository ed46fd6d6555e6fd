"""Times of the rows of a table, put on the clock of the frames."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tactileforge.data.labels.clock import UNITS, date_unit, misfit
from tactileforge.datasets.reading.layout_keys import FrameTable
from tactileforge.errors import DataError


def on_frames(
    table: FrameTable,
    path: Path,
    rows: NDArray[np.float64],
    times: NDArray[np.float64],
    start: float | None = None,
    note: Callable[[str], None] = lambda line: None,
) -> NDArray[np.float64]:
    """Seconds since the first frame of the rows of a table.

    Args:
        table: Its column of times, and their unit.
        path: The CSV.
        rows: float64 (n,), ascending, as they are written.
        times: float64 (T,), seconds of the frames.
        start: Seconds since 1970 of the first frame; dates of rows are taken from there.
        note: Is told of rows that may be right and leave most frames without a label.

    Raises:
        DataError: They do not fit the frames: names the unit or the rate that would.
    """
    assert table.time is not None
    date = date_unit(rows)
    seconds = rows * UNITS[table.unit or "s"]
    if date and start is not None:
        seconds = rows * UNITS[table.unit or date] - start
    found = misfit(seconds, times, table.partial)
    if found is None:
        return seconds
    where = f"{path}: the column {table.time!r} {found.words}"
    if not found.certain:
        note(f"{where}; {found.fix}, and say partial: true if they do")
        return seconds
    fix = found.fix
    if found.unit and found.plain:
        fix = f"{fix}, or say so: unit: {found.unit}"
    elif found.unit:
        fix = f"{fix}, with unit: {found.unit} if it stays so"
    if found.doubtful:
        fix = f"{fix}; if all is right, say partial: true"
    if where.endswith("?"):
        raise DataError(f"{where} {fix[0].upper()}{fix[1:]}")
    raise DataError(f"{where}; {fix}")
