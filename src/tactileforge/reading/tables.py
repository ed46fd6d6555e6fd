"""Labels from CSV files, with a row per frame or on a clock of their own."""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from decimal import Decimal
from pathlib import Path
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from tactileforge.contracts import ACTIONS
from tactileforge.data.labels.align import resample
from tactileforge.data.labels.clock import after_midnight, clock_number
from tactileforge.data.labels.missing import stated
from tactileforge.data.labels.plausible import impossible_row, limits
from tactileforge.errors import ConfigError, DataError, DataNotFoundError, unknown
from tactileforge.reading.files import check_lines, read_text
from tactileforge.reading.layout import check_action
from tactileforge.reading.layout_keys import FrameTable
from tactileforge.reading.records import RECORDS, conversion, read_many, read_records, sheets
from tactileforge.reading.sheets import read_sheet
from tactileforge.reading.split_times import part_of_second
from tactileforge.reading.table_clock import on_frames
from tactileforge.reading.templates import template_columns
from tactileforge.reading.text_tables import in_cells, read_text_table

#: A whole number, as programs write it in a column with empty cells.
_WHOLE = re.compile(r"^(\d+)\.0+$")
#: Mark of a time of day.
_CLOCK = re.compile(r"\d:\d")
#: Place and cells of a row.
Row: TypeAlias = tuple[str, dict[str, str]]
#: Function from a table, its path, its row times, the frames' times and the rows' forces (n, 3) to
#: row times on the frames' clock.
Fit: TypeAlias = Callable[
    [FrameTable, Path, Sequence[Decimal], NDArray[np.float64], NDArray[np.float64]],
    NDArray[np.float64],
]


@dataclass(frozen=True)
class FoundRows:
    """Rows of a table for a touch.

    Attributes:
        images: Rows by frame, for rows with image names; None for rows by frame or time.
        own: Those of the recording, of a table for all; None for all rows of the CSV.
    """

    images: Mapping[int, Row] | None = None
    own: Sequence[Row] | None = None


#: All rows of a CSV, by frame or time.
ALL_ROWS = FoundRows()


def read_force(
    table: FrameTable,
    path: Path,
    times: NDArray[np.float64],
    sensor: str,
    fit: Fit = on_frames,
    found: FoundRows = ALL_ROWS,
) -> NDArray[np.float32]:
    """Forces per frame, with the images' delay applied.

    Args:
        table: Columns, signs, lag and clock of the forces.
        path: Path of the CSV.
        times: float64 (T,), times of the frames, s.
        sensor: Name of the measuring sensor.
        fit: Conversion of row times to the clock of the frames; see `table_clock.on_frames`.
        found: Rows of the touch.

    Returns:
        float32 (T, 3), N. NaN for an empty cell, for an axis without a column, and for frames
        before the first label after the lag.

    Raises:
        DataNotFoundError: There is no such CSV.
        DataError: A cell is not a finite number, or a force beyond the sensor's range; or a row
            has an invalid frame, or is not later than the one before.
    """
    if abs(table.lag_s) > times[-1] - times[0] > 0:
        raise DataError(
            f"{path}: lag_s is {table.lag_s:g}, longer than the recording of "
            f"{times[-1] - times[0]:.3g} s; give seconds, such as 0.07"
        )
    if table.time is not None:
        clock, measured = _on_a_clock(table, path, sensor, found.own)
        at = fit(table, path, clock, times, measured)
        # images are late: what a frame shows was felt lag_s before it
        return resample(times - table.lag_s, at, measured).astype(np.float32)
    force = np.full((len(times), 3), np.nan)
    for frame, where, cells in _per_frame(table, path, len(times), found):
        force[frame] = _force(table, where, cells, sensor)
    return _delayed(times, force, table.lag_s).astype(np.float32)


def _on_a_clock(
    table: FrameTable, path: Path, sensor: str, rows: Sequence[Row] | None
) -> tuple[list[Decimal], NDArray[np.float64]]:
    """Times and forces (n, 3) of the rows of a CSV."""
    assert table.time is not None
    named = [name for name in table.columns if name]
    clock: list[Decimal] = []
    forces = []
    rows = read_cells(path, [*named, table.time]) if rows is None else rows
    part = part_of_second(table.time, rows)
    for where, cells in rows:
        cell = cells[table.time]
        if not any(cells.values()):
            continue  # as spreadsheets write below the last one
        try:
            now = clock_number(cell) if cell else None
        except ValueError as error:
            column = f"{where}, column {table.time!r}"
            if not _CLOCK.search(cell):
                _number(cell, column)  # says the fix
            raise DataError(
                f"{column}: {error}; write numbers, or dates as 2024-10-27 23:59:59.5"
            ) from error
        if now is not None:
            now = (after_midnight(clock[-1], now, cell) if clock else now) + part(cells)
        if now is not None and clock and now == clock[-1]:
            raise DataError(
                f"{where}: the time {cell!r} is that of the row before, too; write times with more "
                "digits, or keep one row of each time"
            )
        if now is None or (clock and now < clock[-1]):
            raise DataError(
                f"{where}: the time {cell!r} is not after that of the row before; sort the rows "
                "by time"
            )
        clock.append(now)
        forces.append(_force(table, where, cells, sensor))
    if not clock:
        raise DataError(f"{path}: no row; add the forces, or remove the recording")
    return clock, np.stack(forces)


def _force(
    table: FrameTable, where: str, cells: Mapping[str, str], sensor: str
) -> NDArray[np.float64]:
    """The force of a row, (3,), N, in our axes; NaN for axes without a label."""
    row = [
        _number(stated(cells[name]), f"{where}, column {name!r}") if name else math.nan
        for name in table.columns
    ]
    # in our axes and newton, before the check: its limits are those of the sensor's axes
    force: NDArray[np.float64] = np.array(row) * table.sign
    if impossible_row(force[None], sensor) is not None:
        raise DataError(
            f"{where}: a force of ({', '.join(f'{axis:g}' for axis in row)}) N, where {sensor} "
            f"can feel {limits(sensor)} N at most; say its unit (force: unit: gf, mN, ...), or "
            "empty the cells"
        )
    return force


def read_actions(
    table: FrameTable, path: Path, count: int, found: FoundRows = ALL_ROWS
) -> NDArray[np.int64]:
    """Actions per frame, int64 (count,), as indices in `ACTIONS`; -1 for an empty cell or NaN.

    Raises:
        DataNotFoundError: There is no such CSV.
        DataError: A row has an invalid frame.
        ConfigError: The name of an action is unknown.
    """
    actions = np.full(count, -1, np.int64)
    for frame, where, cells in _per_frame(table, path, count, found):
        (name,) = map(stated, cells.values())
        if name:
            check_action(name, where)
            actions[frame] = ACTIONS.index(name)
    return actions


def read_tracks(
    table: FrameTable, path: Path, count: int, found: FoundRows = ALL_ROWS
) -> dict[str, NDArray[np.float32]]:
    """Numbers per frame by column, float32 (count,); NaN for an empty cell or a missing row.

    Raises:
        DataNotFoundError: There is no such CSV.
        DataError: A row has an invalid frame, or a cell is not a finite number.
    """
    tracks = {name: np.full(count, np.nan, np.float32) for name in table.columns}
    for frame, where, cells in _per_frame(table, path, count, found):
        for name, cell in cells.items():
            tracks[name][frame] = _number(stated(cell), f"{where}, column {name!r}")
    return tracks


def _per_frame(
    table: FrameTable, path: Path, count: int, found: FoundRows
) -> list[tuple[int, str, dict[str, str]]]:
    """Frame number, place and needed cells of each row of a CSV per frame."""
    named = [name for name in table.columns if name]
    if found.images is not None:
        return [
            (frame, where, {name: cells[name] for name in named})
            for frame, (where, cells) in found.images.items()
        ]
    needed = [*named, *([table.frame] if table.frame else [])]
    out, seen = [], set()
    rows = found.own
    if rows is None:
        rows = read_cells(path, needed, whole=table.frame is None)
    for i, (where, cells) in enumerate(rows):
        if (table.frame or i >= count) and not any(cells.values()):
            continue  # as spreadsheets write below the last one
        text = whole(cells[table.frame]) if table.frame else str(i)
        try:
            frame = int(text)
        except ValueError:
            raise DataError(f"{where}: frame {text!r} is not a whole number; correct it") from None
        if frame >= count and table.partial and not (table.frame and frame == count == len(rows)):
            continue
        if frame >= count and table.frame is None:
            raise DataError(
                f"{where}: a row for each frame, and there are {count} frames: is one missing? "
                "Removing rows may shift the others: give frame: the column of frame numbers, or "
                "times: that of times; of one table for all images, key: that of their names"
            )
        if not 0 <= frame < count:
            raise DataError(
                f"{where}: frame {frame} does not exist, the recording has 0 to {count - 1}; "
                + (
                    "the rows count from 1: leave frame: out, and each is of a frame in turn"
                    if frame == count == len(rows)
                    else "give the CSV of this recording, or correct the numbers if they begin "
                    "elsewhere; of one table for all images, give key: the column of their names; "
                    "if forces go on after the last frame, say partial: true"
                )
            )
        if frame in seen:
            raise DataError(f"{where}: frame {frame} has a row already; remove one of them")
        seen.add(frame)
        out.append((frame, where, {name: cells[name] for name in named}))
    if table.frame is None and len(out) < count:
        raise DataError(
            f"{path}: {len(out)} rows for {count} frames; give the column of the frame numbers "
            "(frame:) or of the seconds (time:), or a row of empty cells (,,) for each frame "
            "without a label"
        )
    return out


def read_cells(path: Path, needed: Sequence[str], whole: bool = False) -> list[Row]:
    r"""Place and cells of each row of a CSV, or of another table; see `records.read_records`.

    Args:
        path: Path of the CSV, see `text_tables`; of a JSON, JSON lines, YAML or .npy, or a pattern
            of such (``mug/*.json``); or of a table of another program, see `sheets.read_sheet`.
        needed: Required columns; a template of several (``{object}/{take}``) becomes one more.
        whole: Whether an empty line is an error: the parser skips it, which shifts rows by frame.

    Raises:
        DataNotFoundError: There is no such CSV.
        DataError: The file is not a CSV, or a row is longer than the header.
        ConfigError: A column does not exist.

    Example:
        >>> _ = Path("labels.csv").write_text("file,object\na.mp4,mug\n")
        >>> [(_, cells)] = read_cells(Path("labels.csv"), ["object"])
        >>> cells["object"]
        'mug'
    """
    templates = [name for name in needed if template_columns(name)]
    if templates:
        parts = [name for one in templates for name in template_columns(one)]
        rows = read_cells(path, [*({*needed} - {*templates}), *parts], whole)
        for template in templates:
            rows = [(where, joined(cells, template)) for where, cells in rows]
        return rows
    many = "*" in path.name
    if not (any(path.parent.glob(path.name)) if many else path.is_file()):
        raise DataNotFoundError(f"{path}: no such CSV; correct the layout, or add the file")
    if convert := conversion(path):
        raise DataError(f"{path}: not a CSV but {convert}")
    suffix = path.suffix.lower()
    if many or suffix in RECORDS or suffix in sheets():
        read = read_records if suffix in RECORDS else read_sheet
        rows = _spread(read_many(path) if many else read(path))
        header = list(rows[0][1]) if rows else []
        for name in needed:
            if name not in header:
                raise ConfigError(f"{path}: {unknown('column', name, header)}")
        return rows
    try:
        return _rows(path, needed, whole)
    except csv.Error as error:
        raise DataError(f"{path}: not a CSV ({error}); save it as one") from error


def joined(cells: Mapping[str, str], template: str) -> dict[str, str]:
    """Cells with one more, named by a template and filled from it; empty if a part is.

    Example:
        >>> joined({"object": "mug", "take": "3.0"}, "{object}/{take}")["{object}/{take}"]
        'mug/3'
    """
    parts = [stated(_WHOLE.sub(r"\1", cells[name])) for name in template_columns(template)]
    return {**cells, template: "/".join(parts) if all(parts) else ""}


def _rows(path: Path, needed: Sequence[str], whole: bool) -> list[Row]:
    text = read_text(path)
    check_lines(path, text)
    table = read_text_table(text)
    header = table.header
    if twice := [name for name in needed if header.count(name) > 1]:
        raise DataError(f"{path}: two columns are called {twice[0]!r}; rename one")
    rows: list[Row] = []
    skipped = False
    for number, cells in table.rows:
        if not cells:
            skipped = True
            continue
        where = f"{path}, row {number}"
        if whole and skipped:  # rows are frames
            raise DataError(
                f"{where}: an empty line is before it; rows are frames here, so write a row of "
                'empty cells (,, or "") for a frame without a label'
            )
        skipped = False
        # a mark behind the last cell parts nothing
        if len(cells) > len(header) and any(cells[len(header) :]):
            raise DataError(
                f"{where}: more cells than the header has; quote commas of texts, and write a "
                "point for those of decimals"
            )
        padded = [*cells, *[""] * (len(header) - len(cells))]
        rows.append((where, dict(zip(header, padded, strict=False))))
    rows = _spread(rows)
    known = list(rows[0][1]) if rows else header
    for name in needed:
        if name not in known:
            fix = "" if table.named else "The file has no line of names: columns are numbered"
            raise ConfigError(f"{path}: {unknown('column', name, known, fix)}")
    return rows


def as_one_row(rows: Sequence[Row]) -> list[Row]:
    """Rows of a table of one image: an array of 3 or 6 numbers is one row, not as many.

    Example:
        >>> as_one_row([("a.npy, row 0", {"0": "1"}), ("", {"0": "2"}), ("", {"0": "3"})])
        [('a.npy, row 0', {'0': '1', '1': '2', '2': '3'})]
    """
    if len(rows) not in (3, 6) or any(list(cells) != ["0"] for _, cells in rows):
        return list(rows)
    return [(rows[0][0], {str(i): cells["0"] for i, (_, cells) in enumerate(rows)})]


def _spread(rows: list[Row]) -> list[Row]:
    """Rows with the values within their cells as columns of their own."""
    for inner in in_cells([cells for _, cells in rows]).values():
        names = dict.fromkeys((name for cells in inner for name in cells), "")
        rows = [
            (where, {**cells, **names, **more})
            for (where, cells), more in zip(rows, inner, strict=True)
        ]
    return rows


def whole(cell: str) -> str:
    """A whole number as such: tables with a gap elsewhere write it as ``12.0``.

    Example:
        >>> whole("12.0"), whole("12"), whole("1.5")
        ('12', '12', '1.5')
    """
    return re.sub(r"\.0+$", "", cell.strip())


def number_or_text(cell: str) -> str | float:
    """The number in a cell, or else its text.

    Example:
        >>> number_or_text("1e3"), number_or_text("mug")
        (1000.0, 'mug')
    """
    try:
        return float(cell)
    except ValueError:
        return cell


def _number(cell: str, where: str) -> float:
    """A finite number; NaN for an empty cell, meaning no label."""
    if not cell:
        return math.nan
    try:
        value = float(cell)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        fix = "leave the cell empty for no label"
        if re.fullmatch(r"[-+]?\d+,\d+", cell):
            fix = f"write a point for its comma: {cell.replace(',', '.')}"
        elif match := re.match(r"[-+]?\d+(\.\d+)?(?=\s*[^\W\d])", cell):
            fix = f"write only the number: {match[0]}"
        raise DataError(f"{where}: {cell!r} is not a finite number; {fix}")
    return value


def _delayed(
    times: NDArray[np.float64], force: NDArray[np.float64], lag: float
) -> NDArray[np.float64]:
    """The force ``lag`` seconds before each frame, interpolated between frames."""
    if lag == 0:
        return force
    place = np.interp(times - lag, times, np.arange(len(times)), left=np.nan, right=np.nan)
    known = np.flatnonzero(np.isfinite(place))
    # The tolerance keeps a lag of whole frames exact: rounding must not mix in a neighbour's NaN.
    before = np.floor(place[known] + 1e-6).astype(int)
    share = np.clip(place[known] - before, 0, None)[:, None]
    share[share < 1e-6] = 0
    after = np.minimum(before + (share[:, 0] > 0), len(times) - 1)
    out = np.full_like(force, np.nan)
    out[known] = force[before] * (1 - share) + force[after] * share
    return out
