"""Guess of the rate of frames without times by the duration of the forces beside them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import islice
from typing import Any

import numpy as np

from tactileforge.data.labels.clock import UNITS, date_unit
from tactileforge.errors import TactileForgeError
from tactileforge.reading.guessing.columns import moments
from tactileforge.reading.guessing.families import Cells, Family, Units, table_of
from tactileforge.reading.guessing.media import ASSUMED_FPS, Part, open_media
from tactileforge.reading.tables import read_cells
from tactileforge.reading.trial_rows import recordings_of

#: Usual rates of cameras, and how near to one a rate counts as that one.
_USUAL, _NEAR = (5, 10, 12.5, 15, 20, 24, 25, 30, 40, 50, 60, 90, 100, 120, 240), 0.04
#: Rates of frames to believe in.
_RATES = 1.0, 500.0
#: Largest ratio of the rates of two recordings, and of a rate and the assumed one, for the same.
_ALIKE, _AS_ASSUMED = 1.1, 1.12
#: Smallest number of frames and rows that tell a rate, and most recordings to look at.
_LEAST, _LOOKED_AT = 4, 50


def guess_rate(part: Part, family: Family, force: Mapping[str, Any]) -> None:
    """Replace the assumed rate of a part by that of its forces if all recordings agree.

    Args:
        part: The files, with their layout and lines; both are changed.
        family: Tables of the forces.
        force: Key of the forces, with the column of their times.
    """
    clock = force.get("times")
    rates = [*_rates(family, clock, part.units)] if clock else []
    if not rates or min(rates) < _RATES[0] or max(rates) > _RATES[1]:
        return
    if max(rates) > _ALIKE * min(rates):
        _say(
            part,
            f"{ASSUMED_FPS} is assumed; forces last as long as frames at {min(rates):.3g} to "
            f"{max(rates):.3g} a second, another rate in each recording",
        )
        return
    rate = float(np.median(rates))
    usual = min(_USUAL, key=lambda one: abs(one / rate - 1))
    if abs(usual / rate - 1) <= _NEAR:
        fps = float(usual)
    elif 1 / _AS_ASSUMED < rate / ASSUMED_FPS < _AS_ASSUMED:
        fps = ASSUMED_FPS
    else:
        fps = float(f"{rate:.3g}")
    if fps == ASSUMED_FPS:
        return
    part.layout["fps"] = int(fps) if fps.is_integer() else fps
    of = f"all {len(rates)} recordings last" if len(rates) > 1 else "the recording lasts"
    _say(part, f"{fps:g} is assumed, so that {of} as long as the forces")


def _say(part: Part, line: str) -> None:
    part.doubts[:] = [f"fps: {line}" if x.startswith("fps:") else x for x in part.doubts]


def _rates(family: Family, clock: str | Mapping[str, str], units: Units) -> Iterator[float]:
    """Frames a second of each recording, if it lasted as long as its forces."""
    column = clock if isinstance(clock, str) else clock["column"]
    unit = "" if isinstance(clock, str) else clock.get("unit", "")
    for count, rows in islice(_tables(family, units), _LOOKED_AT):
        try:
            values = moments(replace(family, rows=rows), column)
        except KeyError:  # of other columns: the reader names it
            continue
        steps = np.diff(values)
        if min(len(values), count) < _LEAST or not (steps > 0).all():
            continue
        second = UNITS[unit or date_unit(values) or "s"]
        yield count / (float(values[-1] - values[0] + np.median(steps)) * second)


def _tables(family: Family, units: Units) -> Iterator[tuple[int, Cells]]:
    """Number of frames and rows of forces of each recording."""
    sharing: dict[str, list[str]] = {}
    for unit in units.files:
        sharing.setdefault(table_of(family, unit, units), []).append("/".join(unit))
    read: dict[str, tuple[Cells, Mapping[str, Sequence[str]]]] = {}
    rows: Cells
    for unit, files in units.files.items():
        count = len(files)
        if units.each == "video":
            frames = open_media(files[0])
            count = 0 if frames is None else len(frames)
        path = table_of(family, unit, units)
        if path not in read:
            try:
                rows = [cells for _, cells in read_cells(units.root / path, [])]
            except TactileForgeError:  # the reader names it
                continue
            rows = family.rows if family.apart and not family.is_own else rows
            cells = [row.get(family.apart, "") for row in rows] if family.apart else []
            read = {path: (rows, recordings_of(cells, sharing[path]))}
        rows, told = read[path]
        if key := family.apart:
            rows = [row for row in rows if "/".join(unit) in told.get(row.get(key, ""), ())]
        yield count, rows
