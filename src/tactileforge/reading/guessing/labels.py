"""Guesses about labels in tables: objects, sensors, captions; and about unread files."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from itertools import pairwise
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
    named_columns,
    time_column,
)
from tactileforge.reading.guessing.families import Family, Units, fits, is_for_all
from tactileforge.reading.guessing.force_headers import FORCE
from tactileforge.reading.guessing.frames import is_film
from tactileforge.reading.guessing.media import Part, open_media
from tactileforge.reading.guessing.sensor_names import named_sensor
from tactileforge.reading.guessing.view_words import FINGERS, VIEWS
from tactileforge.reading.records import RECORDS, conversion
from tactileforge.reading.sides import SIDE_NAMES
from tactileforge.reading.splits import SPLIT_OF_FOLDER
from tactileforge.reading.tables import number_or_text, read_cells
from tactileforge.reading.templates import template_columns
from tactileforge.reading.trial_rows import RECORDING_WORDS
from tactileforge.reading.trials import VERSIONS
from tactileforge.specs.published import spec
from tactileforge.util.untrusted import dump_yaml

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
#: Words before a number that count recordings, images or sensors.
_COUNTED = re.compile(
    rf"{RECORDING_WORDS}|ep|traj|rollout|frame|file|f|sample|day|session|user|v|t|[cd]|"
    "sensor|device|ch|channel|port|gripper|hand|arm|gel|tac|tactile"
)
#: Names of arrays of the classes of pictures.
_CLASSES = re.compile(
    rf"(?:.*[_.-])?(?:y|labels?|class(?:es)?|objects?|targets?)(?:[_.-](?:{'|'.join(SPLIT_OF_FOLDER)}))?"
)
#: Columns of an unread table that are told.
_SHOWN = 8


def guess_labels(part: Part, found: Sequence[Family]) -> tuple[dict[str, Any], list[Family]]:
    """Guess the keys of objects, captions and types of sensors, and their families of tables."""
    doubts = part.doubts
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
            if column and (column != family.key or _names_folders(family, part.units)):
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
    _add_split(keys, family, doubts)
    named = " and ".join(name for name in keys if name not in ("labels", "words", "hold_out"))
    doubts.append(f"labels: {named} by {family.template}")
    if family.key and template_columns(family.key):
        doubt_key(family, family.key, doubts)
    return keys, [family]


def guess_classes(part: Part) -> tuple[dict[str, Any], list[Family]]:
    """Guess the keys of objects of single touches in an array, and their family of tables.

    An array is taken for a film unless its pictures and their classes both change at random.
    """
    for family in part.found:
        column = family.column(OBJECT) or family.column(OBJECT_NUMBER)
        if [*family.rows[0]] == ["0"] and _CLASSES.fullmatch(family.files[0].stem.lower()):
            column = "0"
        cells = [row[column] for row in family.rows] if column else []
        changes = sum(one != other for one, other in pairwise(cells))
        is_each = len(cells) == part.units.count >= 2 * len({*cells}) and 3 * changes > len(cells)
        if not is_each or not is_for_all(family, part.units):
            continue
        film = open_media(part.media[0], part.layout.get("white"))
        if film is None or is_film(film.read, len(film)):
            continue
        part.forget("each", "fps")
        part.layout["each"] = "touch"
        part.doubts += [
            "each: neighboring pictures and their classes differ, so each is taken for a touch of "
            "its own",
            f"labels: object by {family.template}, a row for each picture",
        ]
        return {"labels": {"file": family.template}, "object": f"{{{column}}}"}, [family]
    return {}, []


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
            keys = {"labels": {"file": family.template, "key": family.key}}
            _add_split(keys, family, doubts)
            return keys, [family]
    return {}, []


def _add_split(keys: dict[str, Any], family: Family, doubts: list[str]) -> None:
    """Add the key of a column of splits (``train``, ``test``)."""
    for title in family.rows[0]:
        sides = {row[title]: SPLIT_OF_FOLDER.get(row[title].lower(), "") for row in family.rows}
        if {*sides.values()} == {"train", "val"}:
            keys["hold_out"] = f"{{{title}}}"
            keys["words"] = keys.get("words", {}) | {title: sides}
            doubts.append(f"hold_out: what {title} of {family.template} says")


def _names_pictures(family: Family, column: str) -> bool:
    """Whether a column has the names of pictures, such as those of another side."""
    return all(PurePath(row[column]).suffix.lower() in IMAGE_SUFFIXES for row in family.rows)


def guess_shared(part: Part) -> list[Family]:
    """Guess the values of a file of one row for all recordings, and the rate of their frames.

    The keys are filled in; the families are those of the tables.
    """
    given: dict[str, Any] = {}
    told: list[str] = []
    units, used = part.units, []
    for family in part.found:
        if len(family.rows) > 1 or family.key or family.files[0].suffix.lower() == ".npy":
            continue
        (row,) = family.rows
        said: dict[str, Any] = {}
        column = family.column(_FPS)
        told_fps = number_or_text(row[column]) if column else 0.0
        fps = told_fps if isinstance(told_fps, float) else 0.0
        if fps > 0 and "fps" in part.layout:
            said["fps"] = fps
        elif fps > 0 and units.each == "video" and units.seconds and not units.is_timed:
            used.append(family)
            own = (units.count - 1) / units.seconds
            if abs(own / fps - 1) > _AS_FAST:
                told.append(
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
            told += [f"{name}: {value}, by {family.template}" for name, value in said.items()]
            used.append(family)
            given = said | given
    part.forget(*given)
    part.layout |= given
    part.doubts += told
    return used


def _sensor_column(family: Family) -> str | None:
    """Column of the type of the sensor, first for the side of a family."""
    side = re.escape(family.side)
    own = re.compile(rf"sensors?[._]{side}(?:[._](?:type|model|name))?|{side}[._]sensor")
    return (family.column(own) if side else None) or family.column(SENSOR)


def guess_unit(part: Part) -> tuple[str, list[Family]]:
    """Guess the unit of forces by a value of all rows (``force_unit``); "" without any."""
    for family in part.found:
        column = family.column(_UNIT)
        unit = named_unit(family.rows[0][column]) if column else ""
        if column and unit and is_constant(family, column):
            part.doubts.append(f"force: in {unit}, by {column} of {family.template}")
            return unit, [family]
    return "", []


def _type_of(name: str) -> str:
    """The type of a sensor by its name, or by a name in other letters; "" for none."""
    try:
        return spec(name).name
    except ConfigError:
        return named_sensor(name)


def unread_words(part: Part, family: Family) -> None:
    """Add a line about unread columns of words in a table of forces."""
    read = str(part.layout)
    titles = [title for title, cell in family.rows[0].items() if cell and not _is_moment(cell)]
    titles = [
        title
        for title in titles
        if repr(title) not in read and f"{{{title}}}" not in read and "frame_id" not in title
        if not _names_pictures(family, title)
    ]
    if titles:
        part.doubts.append(
            f"labels: {', '.join(titles[:3])} of {family.template} are not read; if they name the "
            f"object: labels: {{file: {family.template!r}}}, object: '{{{titles[0]}}}'"
        )


def told_by_names(part: Part, has_force: bool) -> None:
    """Add lines about unread forces and words in names."""
    places = [path.relative_to(part.root).with_suffix("").as_posix() for path in part.media]
    forces = [match[0] for name in places if (match := _IN_NAME.search(name.lower()))]
    if not has_force and len({*forces}) > 1 and 2 * len(forces) >= len(places):
        part.doubts.append(
            f"force: names of files say it ({forces[0]}, {forces[-1]}), and it is not read; write "
            "it into a table with a row of each: force: {file: forces.csv, key: file, columns: "
            "[null, null, fz]}"
        )
    last = [unit[-1] for unit in part.units.files if unit]
    names = [PurePath(name).stem if "." in name else name for name in last]
    for mark in "" if part.layout.keys() & {"object", "labels", "recording"} else "_- ":
        parts = [name.split(mark) for name in names]
        if {*map(len, parts)} <= {0, 1} or len({*map(len, parts)}) > 1:
            continue
        for place, column in enumerate(zip(*parts, strict=True), 1):
            words = sorted({*column})
            if 1 < len(words) <= len(names) / 2 and not any(map(_tells_no_object, words)):
                value = f'$(basename "${{f%.*}}" | cut -d"{mark}" -f{place})'
                part.doubts.append(
                    f"object: names have words ({', '.join(words[:3])}), which are not read; a "
                    "table of them is (object for word, if they name it): "
                    + written_labels(part.layout, "word", value)
                )
                return


def _tells_no_object(word: str) -> bool:
    """Whether a part of a name counts, or tells a recording or sensor of several."""
    plain = word.lower().strip("0123456789.")
    known = SIDE_NAMES | SPLIT_OF_FOLDER.keys() | VERSIONS | FINGERS | VIEWS
    return not plain or plain in known or bool(_COUNTED.fullmatch(plain) or named_sensor(plain))


def written_labels(layout: Mapping[str, Any], column: str, value: str) -> str:
    """A command to write a table of labels from the names of files."""
    patterns = layout.get("videos") or layout["images"]
    patterns = [patterns] if isinstance(patterns, str) else patterns
    if layout.get("each") == "sequence":
        patterns = dict.fromkeys(one.rpartition("/")[0] for one in patterns)
    made = f'echo file,{column}; for f in {" ".join(patterns)}; do echo "$f,{value}"; done'
    return f"({made}) > labels.csv"


def left_out(unread: Iterable[Path], root: Path) -> list[str]:
    """Lines about unread tables and files of labels, one per kind."""
    kinds: dict[str, list[str]] = {}
    damaged: dict[str, str] = {}
    for path in unread:
        name = path.relative_to(root).as_posix()
        is_text = path.suffix.lower() in (".csv", ".tsv")
        if is_text and len(damaged) < _DAMAGED and (why := _columns(path)[1]):
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
        columns, _ = _columns(root / first)
        if columns and (named := named_columns(columns)).force[2]:
            force = {"file": first, "columns": [*named.force]}
            force |= {"times": named.times} if named.times else {}
            lines.append(
                f"force: {first}{more} left out: other tables have the forces, or it is of no "
                f"recording by its name; else: {pasted(force)}"
            )
            continue
        said = ", ".join([*columns[:_SHOWN], *["others"] * (len(columns) > _SHOWN)])
        lines.append(
            f"labels: {first}{more} left out, since no force of a known frame, time or image, and "
            f"no name of an object was seen{said and ' in '}{said}; give force: or labels: "
            "of the layout, if it has some, or tracks: for other numbers of frames"
        )
    return lines


def pasted(force: Mapping[str, Any]) -> str:
    """The key ``force`` of a layout as it is written there, in one line."""
    return dump_yaml({"force": force}, default_flow_style=True, width=math.inf).strip()[1:-1]


def _columns(path: Path) -> tuple[list[str], str]:
    """Names of the columns of a table, [] without any; and the reason against reading it."""
    try:
        rows = read_cells(path, [])
    except TactileForgeError as error:
        return [], str(error).removeprefix(f"{path}: ")
    return [name for name in rows[0][1] if not name.isdecimal()] if rows else [], ""


def _is_moment(cell: str) -> bool:
    """Whether a cell is a number, a date or a time of day."""
    try:
        clock_number(cell)
    except ValueError:
        return False
    return True
