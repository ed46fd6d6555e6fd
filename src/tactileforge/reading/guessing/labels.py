"""Guesses about labels in tables: objects, sensors, captions; and about unread files."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path, PurePath
from typing import Any

from tactileforge.data.frames.picture_files import IMAGE_SUFFIXES
from tactileforge.data.labels.clock import clock_number
from tactileforge.data.labels.newtons import named_unit
from tactileforge.errors import ConfigError, TactileForgeError
from tactileforge.reading.guessing.columns import (
    OBJECT,
    OBJECT_NUMBER,
    SENSOR,
    TEXT,
    doubt_key,
    force_columns,
    is_constant,
    time_column,
)
from tactileforge.reading.guessing.families import (
    Family,
    Units,
    fits,
)
from tactileforge.reading.guessing.force_headers import FORCE
from tactileforge.reading.guessing.sensor_names import named_sensor
from tactileforge.reading.records import RECORDS, conversion
from tactileforge.reading.tables import read_cells
from tactileforge.reading.templates import template_columns
from tactileforge.specs.published import spec

_FPS = re.compile(r"(?:camera[_.])?(?:fps|frame_?rate|frames_per_second|rate_hz|hz)")
#: Unit of forces, as ``force_unit`` or ``units.force``, or that of all values.
_UNIT = re.compile(r"(?:.*[._])?(?:(?:forces?|ft)[._ ]?units?|units?[._ ](?:forces?|ft))|units?")
#: A force in the name of a file: a word and a fraction, or a number and a unit.
_IN_NAME = re.compile(
    rf"(?<![a-z])(?:(?:{FORCE}|f[nxyz]?|load)[_=]?-?\d+\.\d+"
    rf"|(?:(?:{FORCE}|f[nxyz]?|load)[_=]?)?-?\d+(?:\.\d+)?_?(?:m?n|k?gf|newtons?))(?![a-z\d])"
)
#: What a column names of a recording, in the order in which one is taken.
_NAMED = (("object", OBJECT), ("object", OBJECT_NUMBER), ("text", TEXT))
#: Tables that are told to be damaged; the others are counted.
_DAMAGED = 5
#: Largest relative difference of two rates that are the same.
_AS_FAST = 0.01
#: Columns of an unread table that are told.
_SHOWN = 8


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
            column = next((t for t in titles if not is_series or is_constant(family, t)), None)
            if column and (column != family.key or _names_folders(family, units)):
                given.setdefault(name, f"{{{column}}}")
        sensor = _sensor_column(family)
        if sensor and is_series and not is_constant(family, sensor):
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
        doubt_key(family, family.key, doubts)
    return keys, [family]


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
        known = {family.key, time_column(family), *force_columns(family)}
        columns = [
            name
            for name in family.rows[0]
            if name not in known and not _names_pictures(family, name)
        ]
        if family.key and "*" not in family.template and columns:
            doubts.append(f"labels: {', '.join(columns[:5])} by {family.template}")
            if template_columns(family.key):
                doubt_key(family, family.key, doubts)
            return {"labels": {"file": family.template, "key": family.key}}, [family]
    return {}, []


def _names_pictures(family: Family, column: str) -> bool:
    """Whether a column has the names of pictures, such as those of another side."""
    return all(PurePath(row[column]).suffix.lower() in IMAGE_SUFFIXES for row in family.rows)


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
        fps = _number(row[column]) if column else 0.0
        if fps > 0 and is_assumed:
            said["fps"] = fps
        elif fps > 0 and units.each == "video" and units.seconds and not units.is_timed:
            used.append(family)
            own = (units.count - 1) / units.seconds
            if abs(own / fps - 1) > _AS_FAST:
                doubts.append(
                    f"times: films say {own:.4g} frames a second, which is taken, and {column} of "
                    f"{family.template} says {fps:g}; if that is right: fps: {fps:g}"
                )
        if not family.is_own and family.files[0].suffix.lower() in RECORDS:
            for name, pattern in (("sensor", SENSOR), ("object", OBJECT), ("text", TEXT)):
                column = _sensor_column(family) if name == "sensor" else family.column(pattern)
                value = row[column] if column else ""
                value = _type_of(value) if name == "sensor" else value
                if value:
                    said[name] = value.replace("{", "{{").replace("}", "}}")
        if said:
            doubts += [f"{name}: {value}, by {family.template}" for name, value in said.items()]
            used.append(family)
            given = said | given
    return given, used


def _sensor_column(family: Family) -> str | None:
    """Column of the type of the sensor, first for the side of a family."""
    side = re.escape(family.side)
    own = re.compile(rf"sensors?[._]{side}(?:[._](?:type|model|name))?|{side}[._]sensor")
    return (family.column(own) if side else None) or family.column(SENSOR)


def guess_unit(found: Sequence[Family], doubts: list[str]) -> tuple[str, list[Family]]:
    """Guess the unit of forces by a value of all rows (``force_unit``); "" without any.

    Args:
        found: Families of tables.
        doubts: Lines, added to.
    """
    for family in found:
        column = family.column(_UNIT)
        unit = named_unit(family.rows[0][column]) if column else ""
        if column and unit and is_constant(family, column):
            doubts.append(f"force: in {unit}, by {column} of {family.template}")
            return unit, [family]
    return "", []


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
    """Add a line about unread columns of words in a table of forces.

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
        if not _names_pictures(family, title)
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
        columns = _columns(root / first)
        lines.append(
            f"labels: {first}{more} left out, since no force of a known frame, time or image, and "
            f"no name of an object was seen{columns and ' in '}{columns}; give force: or labels: "
            "of the layout, if it has some, or tracks: for other numbers of frames"
        )
    return lines


def _columns(path: Path) -> str:
    """The first columns of a table as words; "" for one without names or that cannot be read."""
    try:
        rows = read_cells(path, [])
    except TactileForgeError:
        return ""
    names = [name for name in rows[0][1] if not name.isdecimal()] if rows else []
    more = len(names) > _SHOWN
    return ", ".join([*names[:_SHOWN], *["others"] * more])


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
