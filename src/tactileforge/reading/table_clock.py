"""Conversion of a table's row times to the clock of the frames."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tactileforge.data.labels.clock import UNITS, date_unit, misfit
from tactileforge.errors import DataError
from tactileforge.reading.layout_keys import FrameTable


def on_frames(
    table: FrameTable,
    path: Path,
    rows: NDArray[np.float64],
    times: NDArray[np.float64],
    start: float | None = None,
    note: Callable[[str], None] = lambda line: None,
) -> NDArray[np.float64]:
    """Times of a table's rows, in seconds since the first frame.

    Args:
        table: Column of the times, and their unit.
        path: Path of the CSV.
        rows: float64 (n,), times in the CSV, ascending, in its unit.
        times: float64 (T,), times of the frames, s.
        start: Time of the first frame, seconds since 1970, for rows with dates; None if unknown.
        note: Callback for plausible rows that leave most frames without a label.

    Raises:
        DataError: The rows do not fit the frames; names a fitting unit or rate.
    """
    assert table.time is not None
    date = date_unit(rows)
    seconds = rows * UNITS[table.unit or "s"]
    # rows with dates can be compared with the frames only by the date of the first frame
    if date and start is not None:
        seconds = rows * UNITS[table.unit or date] - start
    found = misfit(seconds, times, table.partial)
    if found is None:
        return seconds
    where = f"{path}: the column {table.time!r} {found.words}"
    if not found.certain:  # few labels are no wrong labels: say it, and go on
        note(f"{where}; {found.fix}, and say partial: true if they do")
        return seconds
    fix = found.fix
    if found.unit and found.plain:
        fix = f"{fix}, or say so: times: {{column: {table.time}, unit: {found.unit}}}"
    elif found.unit:
        fix = f"{fix}, with {{column: {table.time}, unit: {found.unit}}} if it stays so"
    if found.doubtful:
        fix = f"{fix}; if all is right, say partial: true"
    if where.endswith("?"):
        raise DataError(f"{where} {fix[0].upper()}{fix[1:]}")
    raise DataError(f"{where}; {fix}")
