"""Guesses about tables beside recordings: forces, times of frames, objects, sensors."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from decimal import Decimal
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactileforge.data.labels.clock import UNITS, after_midnight, clock_number, date_unit
from tactileforge.data.labels.newtons import NEWTONS, named_unit
from tactileforge.errors import ConfigError, TactileForgeError
from tactileforge.reading.records import RECORDS, conversion
from tactileforge.reading.sensor_names import named_sensor
from tactileforge.reading.series import series_of
from tactileforge.reading.table_families import (
    RECORDING,
    SIDES,
    Family,
    Units,
    apart_by_capitals,
    fits,
    is_for_all,
    recordings,
)
from tactileforge.reading.tables import read_cells
from tactileforge.reading.templates import template_columns
from tactileforge.reading.trial_rows import recordings_of
from tactileforge.reading.view_words import COMMANDS, ROBOT, words_of
from tactileforge.reading.written_names import by_ends
from tactileforge.specs.published import spec

#: Name of what stands before a value of a message (``field.wrench.force.x``), or of a file.
_BEFORE = r"(?:\S*[./])?"
#: Force, in English, German, Dutch, Spanish and Italian.
_FORCE = r"(?:forces?|kraft|kracht|fuerza|forza)"
#: Words for a force along an axis.
_WORDS = {axis: rf"(?:shear|tangential|lateral)(?:[_ ]?force)?[_ ]?{axis}" for axis in "xy"}
_WORDS["z"] = r"(?:normal(?:[_ ]?force)?|force[_ ]?normal)"
#: Headers of columns, without the unit behind them.
_FORCES = {
    axis: re.compile(
        rf"{_BEFORE}(?:(?:{_FORCE}|f)[_ .]?{axis}(?![^\W_]).*|{axis}[_ .]?{_FORCE}(?![^\W_]).*"
        rf"|(?:forces?|wrench(?:es)?|ft|f|fxyz|force_?torques?)(?:_\w+)?[_.]{place}"
        rf"|{_WORDS[axis]}(?![^\W_]).*)"
    )
    for place, axis in enumerate("xyz")
}
#: Header of the only force, without an axis; and words that need a unit.
_ALONE = re.compile(rf"{_BEFORE}(?:{_FORCE}|load|load_?cell|fn)(?:[_ (\[]+\w+[)\]]?)?")
_WEIGHED = re.compile(rf"{_BEFORE}(?:weight|{_FORCE}|load)(?![^\W_])")
_TIME = re.compile(
    r"t|[mun]s|%?(?:times?|zeit|elapsed(?:[_ ]time)?)(?:[_ ]?stamps?)?"
    r"(?:[_ (\[]{1,2}(?:[mun]?s|secs?|seconds?)[)\]]?)?"
    r"|t[_ (\[]{1,2}[mun]?s[)\]]?|stamps?|(?:\w+\.)+(?:time)?stamp"
    r"|(?:\w+\.)*(?:(?:time)?stamp[._])?(?:secs?|seconds?)"
)
_TIME_UNIT = re.compile(r"(?:^|[_ (\[])([mun]s)[)\]]?$")
_FRAME = re.compile(r"(?:video_|image_)?frame(?:_?(?:i?d?x?|number|no|count))?|index")
_OBJECT = re.compile(r"obj(?:ect)?(?:[_ ]?(?:name|class|label))?|label|class|name|material|item")
#: Number of an object, which is its name where no column has that.
_OBJECT_NUMBER = re.compile(r"obj(?:ect)?[_ ]?(?:id|number|no|nr)")
_SENSOR = re.compile(r"(?:tactile_?)?sensor(?:_?(?:type|name|model))?")
_FPS = re.compile(r"(?:camera[_.])?(?:fps|frame_?rate|frames_per_second|rate_hz|hz)")
_TEXT = re.compile(r"text|captions?|descriptions?|instructions?|language(?:_instruction)?|prompt")
#: Words before a force that is none on the gel as it was measured.
_ELSEWHERE = ROBOT | COMMANDS | {"max", "min", "std", "var", "bias"}
#: A force in the name of a file: a word and a fraction, or a number and a unit.
_IN_NAME = re.compile(
    rf"(?<![a-z])(?:(?:{_FORCE}|f[nxyz]?|load)[_=]?-?\d+\.\d+"
    rf"|(?:(?:{_FORCE}|f[nxyz]?|load)[_=]?)?-?\d+(?:\.\d+)?_?(?:m?n|k?gf|newtons?))(?![a-z\d])"
)
#: What a column names of a recording, in the order in which one is taken.
_NAMED = (("object", _OBJECT), ("object", _OBJECT_NUMBER), ("text", _TEXT))
#: Units in names of files: a single letter may be anything there.
_FILE_UNIT = re.compile(r"(?<![a-z])(?:mn|kgf|gf|lbf|grams?|newtons?)(?![a-z])")
#: Stems of arrays by what they hold: an array has no headers.
_FORCE_STEM = re.compile(r"(?:.*[_.-])?(?:forces?|loads?|wrench(?:es)?|ft|fxyz|f)")
_TIME_STEM = re.compile(r"(?:.*[_.-])?(?:times?|timestamps?|stamps?|t)")
#: Ratio of the most negative normal force to the largest from which pressing is negative.
_PULLING = 3.0
#: Ratio of durations up to which two clocks have one unit.
_AS_LONG = 2.5
#: Tables that are told to be damaged; the others are counted.
_DAMAGED = 5
#: Most tables of a family that are looked at for a value of all their rows.
_LOOKED_AT = 50
#: Largest plausible step of frames, s.
_SLOW = 2.0


@dataclass(frozen=True)
class NamedColumns:
    """Columns of a table by what their names say; None for none.

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
    times = _time_column(family, "")
    unit = _TIME_UNIT.search(apart_by_capitals(times or "").lower())
    return NamedColumns(
        (x, y, z),
        times,
        unit[1] if unit else "",
        *map(family.column, (RECORDING, _OBJECT, _TEXT, _SENSOR)),
    )


def guess_apart(
    found: Sequence[Family], units: Units, doubts: list[str]
) -> tuple[dict[str, Any], list[Family]]:
    """Guess what tells images of one folder apart, where a table names several in it.

    Args:
        found: Families of tables.
        units: The recordings, each a folder.
        doubts: Lines, added to.

    Returns:
        Keys of the layout, ``recording`` or ``each``; {} where folders are recordings. And the
        family of tables that says so.
    """
    keyed = [one for one in found if one.key and "*" not in one.template]
    if units.each != "sequence" or not keyed:
        return {}, []
    place = _series_by_name(units)
    for family in keyed:
        rows: dict[str, list[Mapping[str, str]]] = {}
        for row in family.rows:
            if at := place.get(row[str(family.key)].replace("\\", "/").removeprefix("./")):
                rows.setdefault(at, []).append(row)
        episode = family.column(RECORDING)
        if episode == family.key or not episode:
            episode = None
        if episode and any(len({row[episode] for row in own}) > 1 for own in rows.values()):
            doubts.append(f"recording: images are told apart by {episode} of {family.template}")
            return {"recording": f"{{{episode}}}"}, [family]
        for column in map(family.column, (_OBJECT, _TEXT, _SENSOR)):
            if not column or column == family.key:
                continue
            if any(len({row[column] for row in own} - {""}) > 1 for own in rows.values()):
                doubts.append(
                    f"each: {column} of {family.template} differs within a folder and no column "
                    f"tells recordings apart, so each image is taken for a touch of its own; if "
                    f"those of one {column} are a recording: each: sequence, recording: "
                    f"'{{{column}}}'"
                )
                return {"each": "touch"}, [family]
    return {}, []


def _series_by_name(units: Units) -> dict[str, str | None]:
    """The series of each image, by its path or the end of its path; None where several have it."""
    return by_ends(
        (path.relative_to(units.root).as_posix(), "/".join((*unit, series)))
        for unit, paths in units.files.items()
        for series, images in series_of(paths).items()
        for path in images
    )


def guess_times(
    found: Sequence[Family], units: Units, doubts: list[str], apart: str = ""
) -> tuple[dict[str, Any], bool]:
    """Guess the key of the times of frames, and whether these are since 1970.

    Args:
        found: Families of tables.
        units: The recordings.
        doubts: Lines, added to.
        apart: Column that tells the recordings of one folder apart; "" for none.
    """
    usable = []
    for family in found:
        column = _time_column(family)
        has_force = _force_columns(family)[2] is not None
        is_for_frames = family.apart is None and units.each != "touch"
        if column is None or not is_for_all(family, units) or not is_for_frames:
            continue
        values = _moments(family, column)
        if apart and apart in family.rows[0] and len(values):
            first = family.rows[0][apart]
            values = values[[row[apart] == first for row in family.rows]]
        if len(values) < 2 or not (np.diff(values) > 0).all():
            continue
        if units.is_timed and (units.is_dated or not date_unit(values)):
            continue
        # a key of single images alone: in a table of all, one of recordings says nothing of frames
        by_name = family.key is not None and units.each == "sequence"
        if by_name or len(values) == units.count:
            usable.append((has_force, family, column, values, by_name))
    if not usable:
        return {}, units.is_dated
    _, family, column, values, by_name = min(usable, key=lambda one: one[0])
    keys: dict[str, Any] = {"file": family.template, "column": column}
    doubts.append(f"times: those of frames are {column} of {family.template}")
    if by_name:
        keys["key"] = family.key
    date = date_unit(values)
    unit = "" if date else _step_unit(column, float(np.median(np.diff(values))))
    if unit:
        keys["unit"] = unit
        doubts[-1] += f", taken for {unit}"
    return {"times": keys}, bool(date)


def _step_unit(column: str, step: float) -> str:
    """Unit of the times of frames, by the name of their column or the step; "" for seconds."""
    if found := _TIME_UNIT.search(apart_by_capitals(column).lower()):
        return found[1]
    small = [unit for unit in ("ms", "us", "ns") if step * UNITS[unit] < _SLOW]
    return "" if step < _SLOW else (small or ["ns"])[0]


def guess_force(
    found: Sequence[Family], units: Units, doubts: list[str]
) -> tuple[dict[str, Any], list[Family]]:
    """Guess the key of forces, and its family of tables.

    Args:
        found: Families of tables.
        units: The recordings, with what is known of their times.
        doubts: Lines, added to.
    """
    for family in found:
        columns = _force_columns(family)
        if columns[2] is None:
            continue
        if not is_for_all(family, units):
            if family.is_own:
                doubts.append(f"force: not every recording has its {family.template}; left out")
            continue
        clock = _clock(family, units, doubts)
        if clock is None:
            continue
        stated_units = {unit for name in columns if name and (unit := named_unit(name))}
        stated_units = stated_units or {_unit_of_file(family.files[0].stem) or "N"}
        if len(stated_units) > 1 or not stated_units <= NEWTONS.keys():
            said = " and ".join(sorted(stated_units))
            doubts.append(f"force: {family.files[0].name} has it in {said}, left out")
            return {}, [family]
        (unit,) = stated_units
        if family.is_numbered and family.files[0].suffix.lower() != ".npy":
            doubts.append(
                f"force: {family.template} has no names of columns; x, y and z are taken to be "
                f"{', '.join(str(name) for name in columns if name)}"
            )
        table = {"file": family.template, "columns": columns, **clock}
        table |= {} if unit == "N" else {"unit": unit}
        said = "newton" if unit == "N" else unit
        if columns[2] and is_turned(_numbers(family, columns[2])):
            table["sign"] = [1, 1, -1]
            doubts.append(f"force: {columns[2]} is negative where it is large, so z is turned")
        along = "x right, y down, z into the gel, pressing positive"
        if columns[0] is columns[1] is None:
            along = f"{columns[2]} for the normal one, pressing positive; x and y are not known"
        doubts.append(f"force: taken for {said}, {along}")
        return {"force": table}, [family]
    for family in found:
        if others := [name for name in family.rows[0] if _is_elsewhere(name)]:
            doubts.append(
                f"force: {', '.join(others[:3])} of {family.template} act elsewhere by their "
                "names, or are of several, and are left out; if they act on the gel: force: {file: "
                f"{family.template!r}, columns: [...]}}"
            )
            break
    for family in found:
        if others := [name for name in family.rows[0] if _says_no_axis(name)]:
            named = ", ".join((others + ["null"] * 2)[:3])
            doubts.append(
                f"force: {', '.join(others[:6])} of {family.template} say no axis, and are not "
                "read; if they act on the gel, name those along x, y and z: force: {file: "
                f"{family.template!r}, columns: [{named}]}}"
            )
            break
    for family in found:
        lead = _lead(family)
        columns = _numbered_forces(family) if lead else []
        if lead and columns[2] and is_for_all(family, units) and not family.key:
            said = f"frame: {lead!r}" if _counts(family, lead) else f"times: {lead!r}"
            if not units.is_dated and date_unit(_moments(family, lead)):
                said += ", start: contact"
            doubts.append(
                f"force: {family.template} has no names of columns, and a name that tells no "
                f"forces; if it has some: force: {{file: {family.template!r}, {said}, "
                f"columns: {columns}}}"
            )
            break
    return {}, []


def _unit_of_file(stem: str) -> str:
    """The unit of force in the name of a file, but for a single letter; "" for none."""
    words = _FILE_UNIT.search(stem.lower())
    return named_unit(words[0]) if words else ""


def is_turned(force: NDArray[np.float64]) -> bool:
    """Whether a normal force is largely negative, as pressing never is.

    Args:
        force: float64 (n,), in any unit; NaN for no value.

    Example:
        >>> is_turned(np.array([0.1, -5.0])), is_turned(np.array([-0.1, 5.0]))
        (True, False)
    """
    values = force[np.isfinite(force)]
    return bool(
        len(values) and values.min() < -_PULLING * max(0.0, float(values.max())) < 0.0
    ) or bool(len(values) and values.max() <= 0 > values.min())


def _force_columns(family: Family) -> list[str | None]:
    if not family.is_numbered:
        found = [family.column(_FORCES[axis]) for axis in "xyz"]
        ways = (_forces_of_one, _forces_by_unit, _normal_force)
        return found if any(found) else next(filter(any, (way(family) for way in ways)), found)
    if not _is_called(_FORCE_STEM, family):
        return [None] * 3
    return _numbered_forces(family)


def _forces_of_one(family: Family) -> list[str | None]:
    """Columns of forces behind the name of a sensor (``ati_fx``), the only one of the table."""
    names: dict[str, list[str | None]] = {}
    for title in family.rows[0]:
        for place, axis in enumerate("xyz"):
            plain = apart_by_capitals(title.strip()).lower()
            if found := re.fullmatch(rf"(\w+?)[_ ]{_FORCES[axis].pattern}", plain):
                names.setdefault(found[1], [None, None, None])[place] = title
    if family.side and any(not SIDES.isdisjoint(words_of(name)) for name in names):
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
    if len(named) != 1 or _is_constant(family, named[0]):
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


def _says_no_axis(title: str) -> bool:
    """Whether a column is a force by its name or unit, along no known axis."""
    numbered = re.fullmatch(rf"(?:{_FORCE}|f)[_ ]?\d.*", title.strip().lower())
    return bool(numbered) or named_unit(title) in NEWTONS


def _is_elsewhere(title: str) -> bool:
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


def _numbered_forces(family: Family) -> list[str | None]:
    """Columns of forces in a table without names: behind a time, number or name, alone or first."""
    columns = [name for name in family.rows[0] if name != family.key]
    rest = columns[1:] if _lead(family) else columns
    return [*rest[:3]] if len(rest) >= 3 else [None, None, rest[0]] if rest else [None] * 3


def _lead(family: Family) -> str:
    """The first column of a table without names, where it rises before others; "" for none."""
    columns = [name for name in family.rows[0] if name != family.key]
    # three or six columns are forces, with or without torques
    if not family.is_numbered or len(columns) in (1, 3, 6):
        return ""
    values = _numbers(family, columns[0])
    return columns[0] if len(values) > 1 and (np.diff(values) > 0).all() else ""


def _time_column(family: Family, stem: str | None = None) -> str | None:
    if family.is_numbered:
        stem = family.files[0].stem if stem is None else stem
        is_times = _TIME_STEM.fullmatch(stem.lower())
        if is_times and list(family.rows[0]) == ["0"]:
            return "0"
        lead = _lead(family)
        return lead if lead and not _counts(family, lead) else None
    names = [name for name in family.rows[0] if fits(_TIME, name)]
    # the stamp of a message before the time at which it was received
    return next((name for name in names if "stamp" in name.lower()), names[0] if names else None)


def _counts(family: Family, column: str) -> bool:
    """Whether a column counts rows by 1."""
    values = _numbers(family, column)
    return bool(len(values) > 1 and values[0] in (0, 1) and (np.diff(values) == 1).all())


def _clock(family: Family, units: Units, doubts: list[str]) -> dict[str, Any] | None:
    """Keys of the time or frame of a row of forces; None if unknown."""
    if family.apart:
        return _clock_apart(family, units, doubts)
    if family.key and units.each != "video":
        if template_columns(family.key):
            _doubt_key(family, family.key, doubts)
        return {"key": family.key}
    if units.each == "touch":
        return {} if len(family.rows) == 1 else None
    frame, time = family.column(_FRAME), _time_column(family)
    if (lead := _lead(family)) and not time:
        frame = lead
    per_frame = len(family.rows) == units.count
    if frame and per_frame and _counts(family, frame) and _numbers(family, frame)[0] == 1:
        doubts.append(f"force: {frame} counts from 1, so each row is of a frame in turn")
        return {}
    if frame and (per_frame or time is None):
        return {"frame": frame}
    if time is None:
        return {} if per_frame else None
    values = _moments(family, time)
    date = date_unit(values) if len(values) else ""
    if per_frame and len(values) > 1 and values[0] > values[-1] - values[0] and not units.is_dated:
        return {}  # by a clock that began long before: a row for each frame
    if date and not units.is_dated:
        doubts.append(
            f"force: {family.template} has dates in {time} and frames have none; the push in the "
            "pictures tells where both clocks meet (start: contact); better are start: first_row "
            "if both began at once, the time of the first frame as a number, or times: of frames"
        )
        return {"times": time, "start": "contact"}
    if date or len(values) < 2:
        return {"times": time}
    span = float(values[-1] - values[0])
    named = _TIME_UNIT.search(apart_by_capitals(time).lower())
    units_that_fit = [
        unit
        for unit, seconds in UNITS.items()
        if 1 / _AS_LONG < span * seconds / max(units.seconds, 1e-9) < _AS_LONG
    ]
    unit = named[1] if named else [*units_that_fit, "s"][0]
    if unit == "s":
        return {"times": time}
    doubts.append(f"force: {time} of {family.template} is taken for {unit}")
    return {"times": {"column": time, "unit": unit}}


def _clock_apart(family: Family, units: Units, doubts: list[str]) -> dict[str, Any] | None:
    """Keys of a table for all whose rows name recordings; None if they tell no frame or time."""
    key, names = str(family.apart), recordings(units)
    told = recordings_of([row[key] for row in family.rows], names)
    own = [row for row in family.rows if names[0] in told.get(row[key], ())]
    if units.each == "touch":
        frame = family.column(_FRAME)
        clock = {"frame": frame} if frame else None
    else:
        clock = _clock(replace(family, rows=own, key=None, apart=None), units, doubts)
    if not clock:
        return None
    _doubt_key(family, key, doubts)
    return {"key": key, **clock}


def _doubt_key(family: Family, key: str, doubts: list[str]) -> None:
    """Notes the column or columns of a table with names of recordings."""
    columns = template_columns(key) or [key]
    names = (
        f"{columns[0]} names"
        if len(columns) == 1
        else f"{', '.join(columns[:-1])} and {columns[-1]} name together"
    )
    doubts.append(f"key: rows of {family.template} are of the recording that {names}")


def guess_labels(
    found: Sequence[Family], units: Units, doubts: list[str]
) -> tuple[dict[str, Any], list[Family]]:
    """Guess the keys of objects, captions and types of sensors, and their families of tables.

    Args:
        found: Families of tables.
        units: The recordings.
        doubts: Lines, added to.
    """
    best: tuple[int, dict[str, Any], Family] | None = None
    for family in found:
        per_image = "*" in family.template
        if not (family.is_own or family.key):
            continue
        # of the rows of a series, what all of them say
        is_series = len(family.rows) > 1 and not per_image and not family.key
        given: dict[str, Any] = {}
        for name, pattern in _NAMED:
            titles = [title for title in family.rows[0] if fits(pattern, title)]
            column = next((t for t in titles if not is_series or _is_constant(family, t)), None)
            if column and (column != family.key or _names_folders(family, units)):
                given.setdefault(name, f"{{{column}}}")
        sensor = family.column(_SENSOR)
        if sensor and is_series and not _is_constant(family, sensor):
            sensor = None
        types = {row[sensor]: _type_of(row[sensor]) for row in family.rows} if sensor else {}
        if types and all(types.values()):
            given["sensor"] = f"{{{sensor}}}"
        if given and (best is None or len(given) > best[0]):
            labels = {"file": family.template}
            if family.key:
                labels["key"] = family.key
            spelled = "sensor" in given and any(cell != name for cell, name in types.items())
            words = {"words": {sensor: types}} if spelled else {}
            best = len(given), {"labels": labels, **given, **words}, family
    if best is None:
        return _other_columns(found, doubts)
    _, keys, family = best
    named = " and ".join(name for name in keys if name not in ("labels", "words"))
    doubts.append(f"labels: {named} by {family.template}")
    if family.key and template_columns(family.key):
        _doubt_key(family, family.key, doubts)
    return keys, [family]


def _is_constant(family: Family, column: str) -> bool:
    """Whether a column has one value in each of some tables."""
    for path in family.files[:_LOOKED_AT]:
        try:
            cells = read_cells(path, [column])
        except TactileForgeError:  # the reader names it
            continue
        if len({row[column] for _, row in cells}) > 1:
            return False
    return True


def _names_folders(family: Family, units: Units) -> bool:
    """Whether the key of a table has the folders of several recordings, as those of objects."""
    folders = {part for unit in units.files for part in unit[:-1]}
    names = {unit[-1] for unit in units.files if unit}
    cells = {row[str(family.key)] for row in family.rows}
    return cells <= folders - names and len(cells) < len(units.files)


def _other_columns(
    found: Sequence[Family], doubts: list[str]
) -> tuple[dict[str, Any], list[Family]]:
    """Keys of a table by recording with only unknown columns."""
    for family in found:
        known = {family.key, _time_column(family), *_force_columns(family)}
        columns = [name for name in family.rows[0] if name not in known]
        if family.key and "*" not in family.template and columns:
            doubts.append(f"labels: {', '.join(columns[:5])} by {family.template}")
            if template_columns(family.key):
                _doubt_key(family, family.key, doubts)
            return {"labels": {"file": family.template, "key": family.key}}, [family]
    return {}, []


def guess_shared(
    found: Sequence[Family], units: Units, is_assumed: bool, doubts: list[str]
) -> tuple[dict[str, Any], list[Family]]:
    """Guess the values of a file of one row for all recordings, and the rate of their frames.

    Args:
        found: Families of tables.
        units: The recordings.
        is_assumed: Whether the frames have no other rate.
        doubts: Lines, added to.
    """
    given: dict[str, Any] = {}
    used = []
    for family in found:
        if len(family.rows) > 1 or family.key or family.files[0].suffix.lower() == ".npy":
            continue
        (row,) = family.rows
        said: dict[str, Any] = {}
        column = family.column(_FPS)
        if is_assumed and column and (fps := _number(row[column])) > 0:
            said["fps"] = fps
        if not family.is_own and family.files[0].suffix.lower() in RECORDS:
            for name, pattern in (("sensor", _SENSOR), ("object", _OBJECT), ("text", _TEXT)):
                column = family.column(pattern)
                value = row[column] if column else ""
                value = _type_of(value) if name == "sensor" else value
                if value:
                    said[name] = value.replace("{", "{{").replace("}", "}}")
        if said:
            doubts += [f"{name}: {value}, by {family.template}" for name, value in said.items()]
            used.append(family)
            given = said | given
    return given, used


def _number(cell: str) -> float:
    try:
        return float(cell)
    except ValueError:
        return 0.0


def _type_of(name: str) -> str:
    """The type of a sensor by its name, or by a name in other letters; "" for none."""
    try:
        return spec(name).name
    except ConfigError:
        return named_sensor(name)


def unread_words(family: Family, layout: Mapping[str, Any], doubts: list[str]) -> None:
    """Add a line about the columns of words in a table that is read for something else.

    Args:
        family: The table.
        layout: Keys that are read.
        doubts: Lines, added to.
    """
    read = str(layout)
    titles = [title for title, cell in family.rows[0].items() if cell and not _is_moment(cell)]
    titles = [
        title
        for title in titles
        if repr(title) not in read and f"{{{title}}}" not in read and "frame_id" not in title
    ]
    if titles:
        doubts.append(
            f"labels: {', '.join(titles[:3])} of {family.template} are not read; if they name the "
            f"object: labels: {{file: {family.template!r}}}, object: '{{{titles[0]}}}'"
        )


def force_in_names(media: Sequence[Path], root: Path) -> list[str]:
    """Line about forces in the names of files; [] without any.

    Args:
        media: Files of frames.
        root: Folder of the data.
    """
    names = (path.relative_to(root).with_suffix("").as_posix().lower() for path in media)
    found = [match[0] for name in names if (match := _IN_NAME.search(name))]
    if len(set(found)) < 2 or 2 * len(found) < len(media):
        return []
    return [
        f"force: names of files say it ({found[0]}, {found[-1]}), and it is not read; write it "
        "into a table with a row of each: force: {file: forces.csv, key: file, columns: [null, "
        "null, fz]}"
    ]


def left_out(unread: Iterable[Path], root: Path) -> list[str]:
    """Lines about unread tables and files of labels, one per kind."""
    kinds: dict[str, list[str]] = {}
    damaged: dict[str, str] = {}
    for path in unread:
        name = path.relative_to(root).as_posix()
        if len(damaged) < _DAMAGED and (why := _damage(path)):
            damaged[name] = why
        else:
            kinds.setdefault(conversion(path) and path.suffix.lower(), []).append(name)
    lines = [f"labels: {name} is left out: {why}" for name, why in sorted(damaged.items())]
    for kind, names in sorted(kinds.items()):
        first = sorted(names)[0]
        more = f" and {len(names) - 1} more are" if len(names) > 1 else " is"
        if kind:
            lines.append(f"labels: {first}{more} left out: {conversion(root / first)}")
            continue
        lines.append(
            f"labels: {first}{more} left out, since no force of a known frame, time or image, and "
            "no name of an object was seen; give force: or labels: of the layout, if it has some"
        )
    return lines


def _damage(path: Path) -> str:
    """Reason against reading a table; "" for a readable one, and for other files."""
    if path.suffix.lower() not in (".csv", ".tsv"):
        return ""
    try:
        read_cells(path, [])
    except TactileForgeError as error:
        return str(error).removeprefix(f"{path}: ")
    return ""


def _is_moment(cell: str) -> bool:
    """Whether a cell is a number, a date or a time of day."""
    try:
        clock_number(cell)
    except ValueError:
        return False
    return True


def _numbers(family: Family, column: str) -> NDArray[np.float64]:
    """The numbers of a column; empty if a cell is not a number."""
    try:
        return np.array([float(row[column]) for row in family.rows])
    except ValueError:
        return np.array([])


def _moments(family: Family, column: str) -> NDArray[np.float64]:
    """The times of a column: numbers, dates or times of day; empty if a cell is none of them."""
    values: list[Decimal] = []
    try:
        for row in family.rows:
            now = clock_number(row[column])
            values.append(after_midnight(values[-1], now, row[column]) if values else now)
    except ValueError:
        return np.array([])
    return np.array([float(value) for value in values])
