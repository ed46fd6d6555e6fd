"""Columns of tables beside recordings by their headers and cells: forces, times, words."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from decimal import Decimal

import numpy as np
from numpy.typing import NDArray

from tactileforge.data.labels.clock import after_midnight, clock_number
from tactileforge.data.labels.newtons import NEWTONS, named_unit
from tactileforge.errors import TactileForgeError
from tactileforge.reading.guessed_numbers import named_time_unit
from tactileforge.reading.sides import SIDE_NAMES
from tactileforge.reading.splits import SPLIT_OF_FOLDER
from tactileforge.reading.table_families import (
    RECORDING,
    Family,
    fits,
)
from tactileforge.reading.tables import read_cells
from tactileforge.reading.templates import template_columns
from tactileforge.reading.view_words import COMMANDS, ROBOT, apart_by_capitals, words_of

#: Name of what stands before a value of a message (``field.wrench.force.x``), or of a file.
_BEFORE = r"(?:\S*[./])?"
#: Force, in English, German, Dutch, Spanish and Italian.
FORCE = r"(?:forces?|kraft|kracht|fuerza|forza)"
#: Words for a force along an axis.
_WORDS = {axis: rf"(?:shear|tangential|lateral)(?:[_ ]?force)?[_ ]?{axis}" for axis in "xy"}
_WORDS["z"] = r"(?:normal(?:[_ ]?force)?|force[_ ]?normal)"
#: Headers of columns, without the unit behind them.
_FORCES = {
    axis: re.compile(
        rf"{_BEFORE}(?:(?:{FORCE}|f)[_ .]?{axis}(?![^\W_]).*|{axis}[_ .]?{FORCE}(?![^\W_]).*"
        rf"|(?:forces?|wrench(?:es)?|ft|f|fxyz|force_?torques?)(?:_\w+)?[_.]{place}"
        rf"|{_WORDS[axis]}(?![^\W_]).*)"
    )
    for place, axis in enumerate("xyz")
}
#: Header of the only force, without an axis; and words that need a unit.
_ALONE = re.compile(rf"{_BEFORE}(?:{FORCE}|load|load_?cell|fn)(?:[_ (\[]+\w+[)\]]?)?")
_WEIGHED = re.compile(rf"{_BEFORE}(?:weight|{FORCE}|load)(?![^\W_])")
_TIME = re.compile(
    r"t|[mun]s|%?(?:times?|zeit|elapsed(?:[_ ]time)?)(?:[_ ]?stamps?)?"
    r"(?:[_ (\[]{1,2}(?:[mun]?s|secs?|seconds?)[)\]]?)?"
    r"|t[_ (\[]{1,2}[mun]?s[)\]]?|stamps?|(?:\w+\.)+(?:time)?stamp"
    r"|(?:\w+\.)*(?:(?:time)?stamp[._])?(?:secs?|seconds?)"
)
FRAME = re.compile(r"(?:video_|image_)?frame(?:_?(?:i?d?x?|number|no|count))?|index")
OBJECT = re.compile(r"obj(?:ect)?(?:[_ ]?(?:name|class|label))?|label|class|name|material|item")
#: Number of an object, which is its name where no column has that.
OBJECT_NUMBER = re.compile(r"obj(?:ect)?[_ ]?(?:id|number|no|nr)")
SENSOR = re.compile(r"(?:tactile_?)?sensor(?:_?(?:type|name|model))?")
TEXT = re.compile(r"text|captions?|descriptions?|instructions?|language(?:_instruction)?|prompt")
#: Words before a force that is none on the gel as it was measured.
_ELSEWHERE = ROBOT | COMMANDS | {"max", "min", "std", "var", "bias"}
#: Stems of arrays by what they hold, before the name of a split: an array has no headers.
_SPLIT = rf"(?:[_.-](?:{'|'.join(SPLIT_OF_FOLDER)}))?"
_FORCE_STEM = re.compile(rf"(?:.*[_.-])?(?:forces?|loads?|wrench(?:es)?|ft|fxyz|f){_SPLIT}")
_TIME_STEM = re.compile(rf"(?:.*[_.-])?(?:times?|timestamps?|stamps?|t){_SPLIT}")
#: Most tables of a family that are looked at for a value of all their rows.
_LOOKED_AT = 50


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
    x, y, z = (family.column(_FORCES[axis]) for axis in "xyz")
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
        found = [family.column(_FORCES[axis]) for axis in "xyz"]
        ways = (_forces_of_one, _forces_by_unit, _normal_force)
        return found if any(found) else next(filter(any, (way(family) for way in ways)), found)
    if not _is_called(_FORCE_STEM, family):
        return [None] * 3
    return numbered_forces(family)


def _forces_of_one(family: Family) -> list[str | None]:
    """Columns of forces behind the name of a sensor (``ati_fx``), the only one of the table."""
    names: dict[str, list[str | None]] = {}
    for title in family.rows[0]:
        for place, axis in enumerate("xyz"):
            plain = apart_by_capitals(title.strip()).lower()
            if found := re.fullmatch(rf"(\w+?)[_ ]{_FORCES[axis].pattern}", plain):
                names.setdefault(found[1], [None, None, None])[place] = title
    if family.side and any(not SIDE_NAMES.isdisjoint(words_of(name)) for name in names):
        # of a table of both sides
        names = {name: one for name, one in names.items() if family.side in words_of(name)}
    whole = [one for name, one in names.items() if one[2] and _ELSEWHERE.isdisjoint(words_of(name))]
    return whole[0] if len(whole) == 1 else [None] * 3


def _forces_by_unit(family: Family) -> list[str | None]:
    """Columns with a unit of force and an axis, ``sensor_x [N]``; one for each axis."""
    found: list[str | None] = []
    for axis in "xyz":
        named = [title for title in family.rows[0] if axis in words_of(title)]
        of_force = [title for title in named if named_unit(title) in NEWTONS]
        found.append(of_force[0] if len(of_force) == 1 else None)
    return found if all(found) else [None] * 3


def _normal_force(family: Family) -> list[str | None]:
    """The only column of force, as of a load cell: the normal one."""
    named = [title for title in family.rows[0] if _is_normal(title)]
    if len(named) != 1 or is_constant(family, named[0]):
        return [None] * 3
    return [None, None, named[0]]


def _is_normal(title: str) -> bool:
    """Whether a column is called force or load, or weighs in a unit."""
    words = apart_by_capitals(title.strip()).lower()
    if not _ELSEWHERE.isdisjoint(words_of(title)):
        return False
    return bool(_ALONE.fullmatch(words)) or (
        bool(_WEIGHED.match(words)) and named_unit(title) in NEWTONS
    )


def says_no_axis(title: str) -> bool:
    """Whether a column is a force by its name or unit, along no known axis."""
    numbered = re.fullmatch(rf"(?:{FORCE}|f)[_ ]?\d.*", title.strip().lower())
    return bool(numbered) or named_unit(title) in NEWTONS


def is_elsewhere(title: str) -> bool:
    """Whether a column is a force behind another name."""
    plain = apart_by_capitals(title.strip()).lower()
    patterns = (rf"\w+?[_ ]{_FORCES[axis].pattern}" for axis in "xyz")
    return any(re.fullmatch(pattern, plain) for pattern in patterns)


def _is_called(pattern: re.Pattern[str], family: Family) -> bool:
    """Whether the name of a table, or of its folder, tells its content.

    The folder counts where files are named by recordings (``forces/0001.npy``).
    """
    path = family.files[0]
    own = pattern.fullmatch(path.stem.lower())
    named = family.template.rpartition("/")[2].removesuffix(path.suffix)
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
    if not family.is_numbered or len(columns) in (1, 3, 6):
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
    """The numbers of a column; empty if a cell is not a number."""
    try:
        return np.array([float(row[column]) for row in family.rows])
    except ValueError:
        return np.array([])


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
