"""Columns of tables beside recordings by their headers and cells: forces, times, words."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from decimal import Decimal
from pathlib import PurePath

import numpy as np
from numpy.typing import NDArray

from tactileforge.data.labels.clock import UNITS, after_midnight, clock_number
from tactileforge.data.labels.missing import stated
from tactileforge.data.labels.newtons import NEWTONS, named_unit
from tactileforge.errors import TactileForgeError
from tactileforge.reading.guessing.families import RECORDING, Family, fits
from tactileforge.reading.guessing.force_headers import (
    FORCE,
    axes_of_force,
    axis_of,
    is_alone,
    is_elsewhere,
)
from tactileforge.reading.guessing.numbers import named_time_unit
from tactileforge.reading.guessing.view_words import apart_by_capitals, words_of
from tactileforge.reading.split_times import nanoseconds_beside
from tactileforge.reading.splits import SPLIT_OF_FOLDER
from tactileforge.reading.tables import read_cells
from tactileforge.reading.templates import template_columns

#: Whose or which time: a clock, what was stamped, or since when.
_CLOCK = (
    r"(?:ros(?:bag)?|unix|sys(?:tem)?|host|pc|wall|local|recv|receive|header|sensor|ft|robot|daq"
    r"|cam(?:era)?|frame|image|rel(?:ative)?|elapsed|absolute|epoch)"
)
_UNIT_OF_TIME = r"(?:[mun\u00b5\u03bc]?s(?:ecs?)?|(?:milli|micro|nano)?sec(?:ond)?s?)"
_TIME = re.compile(
    rf"%?#?(?:{_CLOCK}[_ ./]?)?"
    r"(?:t|times?|zeit(?:stempel)?|tiempo|epoch|clock|date[_ /]?time|\u65f6\u95f4\u6233?"
    r"|(?:times?[_ ]?)?stamps?)"
    rf"(?:[_ ,/(\[]{{1,2}}(?:in[_ ])?{_UNIT_OF_TIME}[)\]]?|[_ ](?:rel|ft|since[_ ]start))?"
    r"|ts|[mun]s|millis|micros|(?:milli|micro)sec(?:ond)?s|[mu]secs?|unix|elapsed|x[_ ]value"
    r"|(?:\w+\.)+(?:time)?stamp|(?:\w+[._])*(?:(?:time)?stamp[._])?(?:secs?|seconds?)"
)
FRAME = re.compile(
    r"(?:video_|image_|img_|camera_)?frame(?:[_ ]?(?:idx?|i|index|number|num|no\.?|nr\.?|count|#))?"
    r"|(?:image|img)[_ ]?(?:idx?|index|number|num|no|nr)|index"
)
#: Headers of numbers: of frames, where they are in the range of these and leave some out.
_COUNTER = re.compile(r"i|n|no|nr|idx|id|row|step|sample|seq|tick|t[_ ]?idx")
#: Words of columns with another meaning than time, which may rise as well.
_NO_TIME = {"x", "y", "z", "w", "depth", "pos", "position", "disp", "displacement", "dist"}
_NO_TIME |= {"distance", "travel", "angle", "height", "mm", "cm", "um", "deg", "rad", "temp"}
#: Fewest rows of a rising column, and its largest ratio to the duration of the frames.
_LEAST_ROWS, _LASTS = 8, 1.25
OBJECT = re.compile(r"obj(?:ect)?(?:[_ ]?(?:name|class|label))?|label|class|name|material|item")
#: Number of an object, which is its name where no column has that.
OBJECT_NUMBER = re.compile(r"obj(?:ect)?[_ ]?(?:id|number|no|nr)")
SENSOR = re.compile(r"(?:tactile_?)?sensor(?:[_.]?(?:type|name|model))?")
TEXT = re.compile(r"text|captions?|descriptions?|instructions?|language(?:_instruction)?|prompt")
#: Headers of forces without an axis: a word of force, or its letter with a word or number.
_SOME_FORCE = re.compile(
    rf"(?:.*[\W_\d])?(?:\w*{FORCE}|f[_ ]?\d|f[_ ]?(?:t|tot|total|res|abs|mag|norm|sum|shear))"
    r"(?![^\W\d_]).*|load(?![^\W\d_]).*|\|f\|"
)
#: Stems of arrays by what they hold, before the name of a split: an array has no headers.
_SPLIT = rf"(?:[_.-](?:{'|'.join(SPLIT_OF_FOLDER)}))?"
_FORCE_STEM = re.compile(rf"(?:.*[_.-])?(?:forces?|loads?|wrench(?:es)?|ft|fxyz|f){_SPLIT}")
_TIME_STEM = re.compile(rf"(?:.*[_.-])?(?:times?|timestamps?|stamps?|t){_SPLIT}")
#: Most tables of a family that are looked at for a value of all their rows.
_LOOKED_AT = 50
#: Most columns whose ranges are told.
_SHOWN = 12


@dataclass(frozen=True)
class NamedColumns:
    """Columns of a table by their names; None for none.

    Attributes:
        force: Columns of x, y and z.
        times: Column of times.
        time_unit: Unit in the name of that column; "" for none.
        recording: Column that tells recordings apart.
        object: Column of the touched object.
        text: Column of captions.
        sensor: Column of the type of the sensor.
    """

    force: tuple[str | None, str | None, str | None]
    times: str | None
    time_unit: str
    recording: str | None
    object: str | None
    text: str | None
    sensor: str | None


def named_columns(header: Sequence[str]) -> NamedColumns:
    """What the names of columns say.

    Args:
        header: Names; values within others have a point, ``force.0``.

    Example:
        >>> found = named_columns(["episode_index", "t_ms", "force.0", "force.1", "force.2"])
        >>> found.recording, found.times, found.time_unit, found.force
        ('episode_index', 't_ms', 'ms', ('force.0', 'force.1', 'force.2'))
    """
    family = Family("", (), rows=[dict.fromkeys(header, "")])
    x, y, z = axes_of_force(header)
    times = time_column(family, "")
    return NamedColumns(
        (x, y, z),
        times,
        named_time_unit(times or ""),
        *map(family.column, (RECORDING, OBJECT, TEXT, SENSOR)),
    )


def force_columns(family: Family) -> list[str | None]:
    """Headers of the forces along x, y and z; None for an axis without one."""
    if not family.is_numbered:
        found = axes_of_force(numeric(family), family.side)
        ways = (_forces_by_unit, _normal_force, _force_of_file)
        return found if any(found) else next(filter(any, (way(family) for way in ways)), found)
    if not _is_called(_FORCE_STEM, family) or nanoseconds_beside("0", family.rows):
        return [None] * 3
    return numbered_forces(family)


def numeric(family: Family) -> list[str]:
    """Headers of a table but those of words, such as names of files below ``fn``."""
    first = {
        name: next((cell for row in family.rows if (cell := stated(row[name]))), "0")
        for name in family.rows[0]
    }
    return [name for name, cell in first.items() if re.match(r"[-+.]*\d|[-+]?inf", cell.lower())]


def _forces_by_unit(family: Family) -> list[str | None]:
    """Columns with a unit of force and an axis, ``sensor_x [N]``; one for each axis."""
    found: list[str | None] = []
    for axis in "xyz":
        named = [title for title in family.rows[0] if axis in words_of(title)]
        named = [title for title in named if not is_elsewhere(words_of(title))]
        of_force = [title for title in named if named_unit(title) in NEWTONS]
        found.append(of_force[0] if len(of_force) == 1 else None)
    return found if all(found) else [None] * 3


def _normal_force(family: Family) -> list[str | None]:
    """The only column of force, as of a load cell: the normal one."""
    header = numeric(family)
    if any(axis_of(title) and not is_elsewhere(words_of(title)) for title in header):
        return [None] * 3
    named = [title for title in header if is_alone(title)]
    if len(named) != 1 or is_constant(family, named[0]):
        return [None] * 3
    return [None, None, named[0]]


def _force_of_file(family: Family) -> list[str | None]:
    """The only column of values in a table named by the normal axis (``Fz.csv``)."""
    name = re.sub(r"\{\w+\}", "", PurePath(family.template).stem).strip("_-. ")
    known = {family.key, time_column(family), *(t for t in family.rows[0] if fits(FRAME, t))}
    rest = [title for title in numeric(family) if title not in known]
    is_normal = axis_of(name) == "z" and not is_elsewhere(words_of(name))
    return [None, None, rest[0]] if is_normal and len(rest) == 1 else [None] * 3


def says_no_axis(title: str) -> bool:
    """Whether a column is a force by its name or unit, along no known axis."""
    if axis_of(title):
        return False
    plain = apart_by_capitals(title.strip()).lower()
    return bool(_SOME_FORCE.fullmatch(plain)) or named_unit(title) in NEWTONS


def _is_called(pattern: re.Pattern[str], family: Family) -> bool:
    """Whether the name of a table, or of its folder, tells its content.

    The folder counts where files are named by recordings (``forces/0001.npy``).
    """
    path = family.files[0]
    named = family.template.rpartition("/")[2].removesuffix(path.suffix)
    rest = re.sub(r"[_.-]?\{\w+\}[_.-]?", "", named)  # force of force_0001
    own = pattern.fullmatch(path.stem.lower()) or pattern.fullmatch(rest.lower())
    is_of_one = re.fullmatch(r"(?:\{folder\}[_.-])?\{stem\}", named) is not None
    return bool(own or (is_of_one and pattern.fullmatch(path.parent.name.lower())))


def numbered_forces(family: Family) -> list[str | None]:
    """Columns of forces in a table without names: behind a time, number or name, alone or first."""
    columns = [name for name in family.rows[0] if name != family.key]
    rest = columns[1:] if leading_column(family) else columns
    return [*rest[:3]] if len(rest) >= 3 else [None, None, rest[0]] if rest else [None] * 3


def leading_column(family: Family) -> str:
    """The first column of a table without names, where it rises before others; "" for none."""
    columns = [name for name in family.rows[0] if name != family.key]
    # three or six columns are forces, with or without torques
    if not family.is_numbered or len(columns) in (0, 1, 3, 6):
        return ""
    values = numbers(family, columns[0])
    return columns[0] if len(values) > 1 and (np.diff(values) > 0).all() else ""


def time_column(family: Family, stem: str | None = None) -> str | None:
    """Header of the times of a table, or of an array with a stem; None without one."""
    if family.is_numbered:
        stem = family.files[0].stem if stem is None else stem
        is_times = _TIME_STEM.fullmatch(stem.lower())
        if is_times and list(family.rows[0]) == ["0"]:
            return "0"
        lead = leading_column(family)
        return lead if lead and not counts(family, lead) else None
    names = [name for name in family.rows[0] if fits(_TIME, name)]
    # the stamp of a message before the time at which it was received
    return next((name for name in names if "stamp" in name.lower()), names[0] if names else None)


def frame_column(family: Family, count: int) -> tuple[str | None, bool]:
    """Header of the numbers of frames; and whether only its numbers tell it, not its name."""
    header = family.rows[0]
    for name in (name for name in header if fits(FRAME, name)):
        if (values := numbers(family, name)).size and (values == np.rint(values)).all():
            return name, False
    for name in (name for name in header if fits(_COUNTER, name)):
        values, steps = (found := numbers(family, name)), np.diff(found)
        is_whole = bool(len(steps)) and (values == np.rint(values)).all()
        if (
            is_whole
            and steps.min() > 0
            and steps.max() > 1
            and 0 <= values[0] <= values[-1] < count
        ):
            return name, True
    return None, False


def rising_column(family: Family, seconds: float, others: Iterable[str | None]) -> tuple[str, str]:
    """The only rising column as long as the frames, and its unit; "" for none."""
    found = []
    for name in family.rows[0].keys() - {*others} if not family.is_numbered else ():
        values = moments(family, name)
        if len(values) < _LEAST_ROWS or not _NO_TIME.isdisjoint(words_of(name)):
            continue
        span = float(values[-1] - values[0]) if (np.diff(values) > 0).all() else 0.0
        for unit, second in UNITS.items():
            if seconds / _LASTS < span * second < seconds * _LASTS:
                found.append((name, unit))
    return found[0] if len(found) == 1 else ("", "")


def counts(family: Family, column: str) -> bool:
    """Whether a column counts rows by 1."""
    values = numbers(family, column)
    return bool(len(values) > 1 and values[0] in (0, 1) and (np.diff(values) == 1).all())


def doubt_key(family: Family, key: str, doubts: list[str]) -> None:
    """Notes the column or columns of a table with names of recordings."""
    columns = template_columns(key) or [key]
    names = (
        f"{columns[0]} names"
        if len(columns) == 1
        else f"{', '.join(columns[:-1])} and {columns[-1]} name together"
    )
    doubts.append(f"key: rows of {family.template} are of the recording that {names}")


def is_constant(family: Family, column: str) -> bool:
    """Whether a column has one value in each of some tables."""
    for path in family.files[:_LOOKED_AT]:
        try:
            cells = read_cells(path, [column])
        except TactileForgeError:  # the reader names it
            continue
        if len({row[column] for _, row in cells}) > 1:
            return False
    return True


def numbers(family: Family, column: str) -> NDArray[np.float64]:
    """The numbers of a column, NaN for an empty cell; empty if a cell is not a number."""
    try:
        return np.array([float(stated(row[column]) or "nan") for row in family.rows])
    except ValueError:
        return np.array([])


def looks_of(family: Family) -> str:
    """Content of the columns of a table without names: the range of each, or its first word."""
    said = []
    for name, cell in family.rows[0].items():
        values = numbers(family, name)
        values = values[np.isfinite(values)] + 0.0  # no -0
        are = f"{values.min():.10g} to {values.max():.10g}" if len(values) else repr(cell)
        said.append(f"{name}: {are}")
    return ", ".join(said[:_SHOWN])


def moments(family: Family, column: str) -> NDArray[np.float64]:
    """The times of a column: numbers, dates or times of day; empty if a cell is none of them."""
    values: list[Decimal] = []
    try:
        for row in family.rows:
            now = clock_number(row[column])
            values.append(after_midnight(values[-1], now, row[column]) if values else now)
    except ValueError:
        return np.array([])
    return np.array([float(value) for value in values])
