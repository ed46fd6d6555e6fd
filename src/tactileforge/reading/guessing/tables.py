"""Guesses about tables beside recordings: forces and times of frames."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import islice
from pathlib import PurePath
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactileforge.data.labels.clock import UNITS, date_unit
from tactileforge.data.labels.newtons import NEWTONS, named_unit
from tactileforge.errors import TactileForgeError
from tactileforge.reading.guessing.columns import (
    FRAME,
    OBJECT,
    SENSOR,
    TEXT,
    counts,
    doubt_key,
    force_columns,
    frame_column,
    leading_column,
    looks_of,
    moments,
    numbered_forces,
    numbers,
    numeric,
    rising_column,
    says_no_axis,
    time_column,
)
from tactileforge.reading.guessing.families import (
    RECORDING,
    Family,
    Units,
    is_for_all,
    recordings,
    table_of,
    without_table,
)
from tactileforge.reading.guessing.force_headers import axis_of
from tactileforge.reading.guessing.labels import guess_unit, pasted
from tactileforge.reading.guessing.media import Part
from tactileforge.reading.guessing.numbers import AXES, guess_sign, likely_unit, named_time_unit
from tactileforge.reading.name_times import frame_numbers
from tactileforge.reading.series import series_of
from tactileforge.reading.split_times import nanoseconds_beside
from tactileforge.reading.tables import read_cells, whole
from tactileforge.reading.templates import template_columns
from tactileforge.reading.trial_rows import recordings_of
from tactileforge.reading.trials import trials_of
from tactileforge.reading.written_names import by_ends

#: Most tables that are looked at for rows after the last frame.
_LOOKED_AT = 500
#: Units in names of files: a single letter may be anything there.
_FILE_UNIT = re.compile(r"(?<![a-z])(?:mn|kgf|gf|lbf|grams?|newtons?)(?![a-z])")
#: Share of the largest normal force below which one is at rest.
_REST = 0.25
#: Ratios of the durations of forces and frames for one unit; the rate of frames may be assumed.
_AS_LONG = 0.4, 10.0


def guess_apart(part: Part) -> list[Family]:
    """Guess what tells images of one folder apart, where a table names several in it.

    The keys, ``recording`` or ``each``, are filled in; the family is that of the table.
    """
    units = part.units
    keyed = [one for one in part.found if one.key and "*" not in one.template]
    if units.each != "sequence" or not keyed or "recording" in part.layout:
        return []
    # none for the end of a path that several have
    place = by_ends(
        (path.relative_to(units.root).as_posix(), "/".join((*unit, series)))
        for unit, paths in units.files.items()
        for series, images in series_of(paths).items()
        for path in images
    )
    for family in keyed:
        rows: dict[str, list[Mapping[str, str]]] = {}
        for row in family.rows:
            if at := place.get(row[str(family.key)].replace("\\", "/").removeprefix("./")):
                rows.setdefault(at, []).append(row)
        episode = family.column(RECORDING)
        if episode == family.key or not episode:
            episode = None
        if episode and any(len({row[episode] for row in own}) > 1 for own in rows.values()):
            part.forget("each")
            part.layout |= {"each": "sequence", "recording": f"{{{episode}}}"}
            by = f"{episode} of {family.template}"
            part.doubts.append(f"recording: images are told apart by {by}")
            return [family]
        for column in map(family.column, (OBJECT, TEXT, SENSOR)):
            if not column or column == family.key:
                continue
            if any(len({row[column] for row in own} - {""}) > 1 for own in rows.values()):
                part.forget("each", "fps", "times")
                part.layout["each"] = "touch"
                part.doubts.append(
                    f"each: {column} of {family.template} differs within a folder and no column "
                    f"tells recordings apart, so each image is taken for a touch of its own; if "
                    f"those of one {column} are a recording: each: sequence, recording: "
                    f"'{{{column}}}'"
                )
                return [family]
    return []


def guess_times(part: Part, apart: str) -> dict[str, Any]:
    """Guess the key of the times of frames; the units learn whether these are since 1970."""
    usable, units = [], part.units
    for family in part.found:
        column = time_column(family)
        has_force = force_columns(family)[2] is not None
        is_for_frames = family.apart is None and units.each != "touch"
        if column is None or not is_for_all(family, units) or not is_for_frames:
            continue
        values = moments(family, column)
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
        return {}
    _, family, column, values, by_name = min(usable, key=lambda one: one[0])
    keys: dict[str, Any] = {"file": family.template, "column": column}
    part.doubts.append(f"times: those of frames are {column} of {family.template}")
    if by_name:
        keys["key"] = family.key
    date = date_unit(values)
    step = float(np.median(np.diff(values)))
    unit = "" if date else named_time_unit(column) or likely_unit(step)
    if unit not in ("", "s"):
        keys["unit"] = unit
        part.doubts[-1] += f", taken for {unit}"
    part.units = replace(units, is_dated=bool(date))
    return {"times": keys}


def guess_force(part: Part) -> tuple[dict[str, Any], list[Family]]:
    """Guess the key of forces, and its families of tables."""
    found, units, doubts = part.found, part.units, part.doubts
    # tables of most recordings, where none are of all
    lacking = {id(family): without_table(family, units) for family in found}
    for family in sorted(found, key=lambda family: bool(lacking[id(family)])):
        columns = force_columns(family)
        if columns[2] is None:
            continue
        if not (is_for_all(family, units) or lacking[id(family)] or _is_log(family, units)):
            if family.is_own:
                doubts.append(f"force: not every recording has its {family.template}; left out")
            continue
        clock = _clock(family, units, doubts)
        if clock is None:
            of_force = [name for name in columns if name]
            others = [name for name in family.rows[0] if name not in of_force]
            beside = f" ({', '.join(others[:6])})" if others else ""
            force = {"file": family.template, "columns": columns, "times": "COLUMN"}
            doubts.append(
                f"force: {', '.join(of_force)} of {family.template} are left out, as no other "
                f"column{beside} tells the time, frame or image of a row; if one does, it is "
                f"times:, frame: or key: of {pasted(force)}"
            )
            continue
        stated_units = {unit for name in columns if name and (unit := named_unit(name))}
        used = [family]
        if not stated_units:
            said, of_unit = guess_unit(part)
            stated_units = {said or _unit_of_file(family.files[0].stem) or "N"}
            used += of_unit
        if len(stated_units) > 1 or not stated_units <= NEWTONS.keys():
            said = " and ".join(sorted(stated_units))
            doubts.append(f"force: {family.files[0].name} has it in {said}, left out")
            return {}, used
        (unit,) = stated_units
        if family.is_numbered and family.files[0].suffix.lower() != ".npy":
            doubts.append(
                f"force: {family.template} has no names of columns; x, y and z are taken to be "
                f"{', '.join(str(name) for name in columns if name)}"
            )
        table = {"file": family.template, "columns": columns, **clock}
        table |= _partial(family, lacking[id(family)], clock, units, doubts)
        table |= {} if unit == "N" else {"unit": unit}
        said = "newton" if unit == "N" else unit
        if columns[2]:
            values = numbers(family, columns[2])
            table |= guess_sign(columns[2], values, doubts)
            if units.each != "touch" and not clock.keys() <= {"key"}:
                doubts += _doubts_of(family, columns[2], values, units)
        along = AXES
        if columns[0] is columns[1] is None:
            along = f"{columns[2]} for the normal one, pressing positive; x and y are not known"
        doubts.append(f"force: taken for {said}, {along}")
        others = [name for name in numeric(family) if axis_of(name) and name not in columns]
        if others:
            doubts.append(
                f"force: {columns[2]} and no other column of {family.template} is taken for that "
                f"on the gel: {', '.join(others[:6])} are left out"
            )
        return {"force": table}, used
    _ask(part)
    return {}, []


def _is_log(family: Family, units: Units) -> bool:
    """Whether dates in a table of all recordings tell the rows of each."""
    time = None if family.is_own else time_column(family)
    return units.is_dated and time is not None and bool(date_unit(moments(family, time)))


def _doubts_of(
    family: Family, name: str, values: NDArray[np.float64], units: Units
) -> Iterator[str]:
    """Lines about a normal force away from 0, and about one table for several trials."""
    sizes = np.abs(values[np.isfinite(values)])
    if len(sizes) > 1 and sizes.min() > _REST * sizes.max():
        yield (
            f"force: {name} of {family.template} is never near 0 ({sizes.min():.3g} to "
            f"{sizes.max():.3g}); if nothing touches in some of its rows, subtract their value"
        )
    sharing: dict[str, list[str]] = {}
    for unit in units.files if family.is_own and not family.apart and not family.key else ():
        sharing.setdefault(table_of(family, unit, units), []).append("/".join(unit))
    for path, names in sharing.items():
        if len({*trials_of([str(PurePath(one).with_suffix("")) for one in names])}) > 1:
            yield (
                f"force: {path} is taken for that of {names[0]} and of {names[1]}, each from its "
                "first row on; if its rows are of one after the other, add a column with their "
                "names"
            )
            return


def _ask(part: Part) -> None:
    """Add lines about columns of forces of unknown axis, place or name."""
    found, units, doubts = part.found, part.units, part.doubts
    for family in found:
        others = [name for name in numeric(family) if axis_of(name)]
        columns = [next((x for x in others if axis_of(x) == axis), None) for axis in "xyz"]
        # fx and fy without fz are of a camera
        if columns[2] and force_columns(family)[2] is None:
            clock = _clock(family, units, []) if is_for_all(family, units) else None
            doubts.append(
                f"force: {', '.join(others[:3])} of {family.template} act elsewhere by their "
                "names, or are of several, and are left out; if they act on the gel: "
                + pasted({"file": family.template, "columns": columns, **(clock or {})})
            )
            break
    for family in found:
        if others := [name for name in numeric(family) if says_no_axis(name)]:
            clock = _clock(family, units, []) if is_for_all(family, units) else None
            several = f"{', '.join(others[:6])} of {family.template} say no axis, and are not read"
            which = f"if {others[0]} presses along z (else name those along x, y and z)"
            columns = [None, None, others[0]]
            doubts.append(
                f"force: {several}; {which}: "
                f"{pasted({'file': family.template, 'columns': columns, **(clock or {})})}"
            )
            break
    for family in found:
        rest = [name for name in numeric(family) if name not in ("0", "1")]
        if not nanoseconds_beside("0", family.rows) or not is_for_all(family, units) or not rest:
            continue
        columns = [*rest[:3]] if len(rest) >= 3 else [None, None, rest[0]]
        force = {"file": family.template, "columns": columns, "times": "0"}
        force |= {} if units.is_dated else {"start": "contact"}
        named = ", ".join(filter(None, columns))
        doubts.append(
            f"force: {family.template} has no names of columns and is not read: 0 and 1 look like "
            f"seconds and nanoseconds ({looks_of(family)}); if {named} are forces: {pasted(force)}"
        )
        break
    for family in found:
        lead = leading_column(family)
        columns = numbered_forces(family) if lead else []
        if lead and columns[2] and is_for_all(family, units) and not family.key:
            said = f"frame: {lead!r}" if counts(family, lead) else f"times: {lead!r}"
            if not units.is_dated and date_unit(moments(family, lead)):
                said += ", start: contact"
            doubts.append(
                f"force: {family.template} has no names of columns, and a name that tells no "
                f"forces; if it has some: force: {{file: {family.template!r}, {said}, "
                f"columns: {columns}}}"
            )
            break


def guess_tracks(part: Part, rest: Sequence[Family]) -> tuple[dict[str, Any], list[Family]]:
    """Guess the key of tracks, columns of 0 and 1 of frames in the rest of the tables."""
    units = part.units
    for family in rest if units.each != "touch" else ():
        names = [] if family.is_numbered or family.apart else [*family.rows[0]]
        columns = [name for name in names if {*map(str, numbers(family, name))} == {"0.0", "1.0"}]
        frame, _ = frame_column(family, units.count)
        columns = [name for name in columns if name not in (frame, family.key)]
        rows = {"frame": frame} if frame else {"key": family.key} if family.key else {}
        if not columns or not is_for_all(family, units):
            continue
        if not rows and len(family.rows) != units.count:
            continue
        part.doubts.append(f"tracks: {', '.join(columns)} of each frame by {family.template}")
        return {"tracks": {"file": family.template, **rows, "columns": columns}}, [family]
    return {}, []


def _partial(
    family: Family,
    lacking: Sequence[Sequence[str]],
    clock: Mapping[str, Any],
    units: Units,
    doubts: list[str],
) -> dict[str, Any]:
    """Key of tables with too few files, or with rows after the last frame."""
    if lacking:
        more = f" and {len(lacking) - 1} more" if len(lacking) > 1 else ""
        doubts.append(f"force: {'/'.join(lacking[0])}{more} without {family.template} get no force")
    longer = [unit for unit, rows in _beyond(family, clock, units) if rows]
    if longer:
        more = f" and {len(longer) - 1} more" if len(longer) > 1 else ""
        doubts.append(
            f"force: {family.template} goes on after the last frame of {longer[0]}{more}; the "
            "last frames are taken to be lost"
        )
    return {"partial": True} if lacking or longer else {}


def _beyond(family: Family, clock: Mapping[str, Any], units: Units) -> Iterator[tuple[str, int]]:
    """Recordings with the number of rows of frames after their last one."""
    frame = clock.get("frame", None if clock else family.column(FRAME))
    if not frame or units.each != "sequence" or not family.is_own or "*" in family.template:
        return
    for unit, files in islice(units.files.items(), _LOOKED_AT):
        try:
            rows = read_cells(units.root / table_of(family, unit, units), [frame])
            numbers = frame_numbers([path.stem for path in files]) or range(len(files))
            beyond = [int(whole(cells[frame])) > numbers[-1] for _, cells in rows]
            more = sum(beyond) if clock else len(rows) - len(files)
        except (TactileForgeError, ValueError):  # the reader names it
            continue
        yield "/".join(unit), max(0, more)


def _unit_of_file(stem: str) -> str:
    """The unit of force in the name of a file, but for a single letter; "" for none."""
    words = _FILE_UNIT.search(stem.lower())
    return named_unit(words[0]) if words else ""


def _clock(family: Family, units: Units, doubts: list[str]) -> dict[str, Any] | None:
    """Keys of the time or frame of a row of forces; None if unknown."""
    if family.apart:
        return _clock_apart(family, units, doubts)
    if family.key and units.each != "video":
        if template_columns(family.key):
            doubt_key(family, family.key, doubts)
        return {"key": family.key}
    if units.each == "touch":
        return {} if len(family.rows) == 1 else None
    time = time_column(family)
    frame, is_told = frame_column(family, units.count)
    if (lead := leading_column(family)) and not time:
        frame, is_told = lead, False
    per_frame = len(family.rows) == units.count
    if time is None and not per_frame and (frame is None or is_told):
        time, unit = rising_column(family, units.seconds, [frame, *force_columns(family)])
        if time:
            doubts.append(
                f"force: {time} of {family.template} rises and lasts as long as the frames, so it "
                f"is taken for the time of a row, in {unit}"
            )
            return {"times": time if unit == "s" else {"column": time, "unit": unit}}
        time = None
        if frame:
            doubts.append(f"force: {frame} of {family.template} is taken for the number of a frame")
    if frame and per_frame and counts(family, frame) and numbers(family, frame)[0] == 1:
        doubts.append(f"force: {frame} counts from 1, so each row is of a frame in turn")
        return {}
    if frame and (per_frame or time is None):
        return {"frame": frame}
    if time is None:
        return {} if per_frame else None
    values = moments(family, time)
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
    units_that_fit = [
        unit
        for unit, seconds in UNITS.items()
        if _AS_LONG[0] < span * seconds / max(units.seconds, 1e-9) < _AS_LONG[1]
    ]
    unit = named_time_unit(time) or [*units_that_fit, "s"][0]
    if unit == "s":
        return {"times": time}
    doubts.append(f"force: {time} of {family.template} is taken for {unit}")
    return {"times": {"column": time, "unit": unit}}


def _clock_apart(family: Family, units: Units, doubts: list[str]) -> dict[str, Any] | None:
    """Keys of a table with names of recordings in its rows; None if they tell no frame or time."""
    key, names = str(family.apart), recordings(units, family)
    told = recordings_of([row[key] for row in family.rows], names)
    own = [row for row in family.rows if names[0] in told.get(row[key], ())]
    if units.each == "touch":
        frame, _ = frame_column(family, units.count)
        clock = {"frame": frame} if frame else None
    else:
        clock = _clock(replace(family, rows=own, key=None, apart=None), units, doubts)
    if not clock:
        return None
    doubt_key(family, key, doubts)
    return {"key": key, **clock}
