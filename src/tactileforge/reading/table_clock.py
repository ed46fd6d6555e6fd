"""Conversion of a table's row times to the clock of the frames."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from decimal import Decimal
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tactileforge.data.labels.align import meeting
from tactileforge.data.labels.clock import UNITS, date_unit, misfit, seconds_since
from tactileforge.errors import DataError
from tactileforge.reading.files import DamagedFileError
from tactileforge.reading.layout_keys import FrameTable

#: Smallest correlation of force and picture for an alignment by contact, and its smallest fall on
#: both sides.
SURE, PROMINENT = 0.6, 0.15
_STARTS = (
    "say where both clocks meet: start: first_row, start: contact (looks for the push in the "
    "pictures), or start: the time of the first frame by this clock"
)


def on_frames(
    table: FrameTable,
    path: Path,
    exact: Sequence[Decimal],
    times: NDArray[np.float64],
    force: NDArray[np.float64],
    start: Decimal | None = None,
    note: Callable[[str], None] = lambda line: None,
    change: Callable[[], NDArray[np.float64]] | None = None,
) -> NDArray[np.float64]:
    """Times of a table's rows, in seconds since the first frame.

    Args:
        table: Column of the times, their unit, and where they start.
        path: Path of the CSV.
        exact: Times in the CSV, ascending, in its unit.
        times: float64 (T,), times of the frames, s.
        force: float64 (n, 3), N, of the rows.
        start: Time of the first frame, seconds since 1970, for rows with dates; None if unknown.
        note: Callback for plausible rows that leave most frames without a label, and for the
            correlation of an alignment by contact.
        change: Function to the difference of each frame from the background, (T,), for
            ``start: contact``.

    Raises:
        DataError: The rows do not fit the frames; names a fitting unit or rate.
        DamagedFileError: No contact tells where they start.
    """
    assert table.time is not None
    date = date_unit(np.array([float(row) for row in exact]))
    unit = table.unit or date or "s"
    second = Decimal(str(UNITS[unit]))
    zero = Decimal(0)
    if table.start in ("contact", "first_row"):
        zero = exact[0] * second
    elif isinstance(table.start, int | float):
        zero = Decimal(str(table.start)) * second
    # rows with dates can be compared with the frames only by the date of the first frame
    elif date and start is not None:
        zero = start
    else:
        unit = table.unit or "s"
    seconds = seconds_since(exact, zero, unit)
    if table.start == "contact":
        assert change is not None
        return _by_contact(table, path, seconds, times, force, note, change())
    found = misfit(seconds, times, table.partial)
    if found is None:
        return seconds
    where = f"{path}: the column {table.time!r} {found.words}"
    if not found.certain:  # few labels are no wrong labels: say it, and go on
        note(f"{where}; {found.fix}, and say partial: true if they do")
        return seconds
    fix = found.fix
    unit = f"times: {{column: {table.time}, unit: {found.unit}}}"
    if date and start is None and table.start is None:
        fix = f"frames have no dates: {_STARTS}"
    elif found.unit and found.plain:
        fix = f"{fix}, or say so: {unit}"
    elif found.unit:
        fix = f"{fix}, with {unit} if it stays so, or {_STARTS}"
    elif "zero" in found.words or "overlap" in found.words:
        fix = f"{fix}, or {_STARTS}"
    if found.doubtful:
        fix = f"{fix}; if all is right, say partial: true"
    if where.endswith("?"):
        raise DataError(f"{where} {fix[0].upper()}{fix[1:]}")
    raise DataError(f"{where}; {fix}")


def _by_contact(
    table: FrameTable,
    path: Path,
    rows: NDArray[np.float64],
    times: NDArray[np.float64],
    force: NDArray[np.float64],
    note: Callable[[str], None],
    change: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Times of rows whose forces fit best to the change of the pictures."""
    where = f"{path}: the column {table.time!r}"
    if found := misfit(rows, times, partial=True):
        raise DataError(f"{where}, from its first row on, {found.words}; give its unit: ms, us, ns")
    size = np.abs(force[:, 2])
    if not np.isfinite(size).any():
        size = np.sqrt(np.nansum(force**2, axis=1))
    met = meeting(rows, size, times, change)
    if not (met.correlation >= SURE and met.prominence >= PROMINENT):
        said = f"fit best with a correlation of {met.correlation:.2f}"
        if np.isnan(met.correlation):
            said = "do not change"
        elif met.correlation >= SURE:
            said = "fit at many shifts alike"
        raise DamagedFileError(  # of this recording: others have a press in them
            f"{where}: start: contact: forces and pictures {said}, which tells no start; give "
            "start: first_row, or the time of the first frame by this clock"
        )
    also = "" if np.isnan(met.other) else f"; they fit about as well at {met.other:+.2f} s"
    note(
        f"{path.name}: start: contact puts the first row at {met.seconds:+.2f} s of the frames, "
        f"where forces and pictures correlate by {met.correlation:.2f}{also}"
    )
    return rows + met.seconds
