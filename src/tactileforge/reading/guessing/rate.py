"""Guess of the rate of frames without times by the duration of the forces beside them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactileforge.data.frames.lazy import ImageFrames
from tactileforge.data.frames.video import VideoFrames
from tactileforge.data.labels.clock import UNITS, date_unit
from tactileforge.errors import TactileForgeError
from tactileforge.reading.guessing.columns import moments, numbers
from tactileforge.reading.guessing.families import Cells, Family, Units, table_of
from tactileforge.reading.guessing.media import ASSUMED_FPS, Part, open_media
from tactileforge.reading.table_clock import SURE
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
#: Recordings whose pictures are compared with forces, frames of each, and the smallest difference
#: of correlations that tells one of two rates.
_SEEN, _SAMPLES, _BETTER = 2, 64, 0.1


@dataclass(frozen=True)
class _Take:
    """A recording beside its forces.

    Attributes:
        files: Its images, or its film.
        count: Number of frames.
        times: float64 (n,), times of the forces, s.
        normal: float64 (n,), normal force.
    """

    files: Sequence[Path]
    count: int
    times: NDArray[np.float64]
    normal: NDArray[np.float64]

    @property
    def rate(self) -> float:
        """Frames a second, if these lasted as long as the forces."""
        step = np.median(np.diff(self.times))
        return self.count / float(self.times[-1] - self.times[0] + step)


def guess_rate(part: Part, family: Family, force: Mapping[str, Any]) -> None:
    """Replace the assumed rate of a part by that of its forces if all recordings agree.

    Where the push in the pictures fits the forces better at the assumed rate, that one stays; where
    it fits better at theirs than at the rate of films, a line says so.
    """
    assumes = part.assumes_rate
    takes = [*islice(_takes(part, family, force), _LOOKED_AT if assumes else _SEEN)]
    rates = [take.rate for take in takes]
    if not rates or min(rates) < _RATES[0] or max(rates) > _RATES[1]:
        return
    own = ASSUMED_FPS if assumes else _rate_of(takes[0].files[0])
    if max(rates) > _ALIKE * min(rates):
        if assumes:
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
    elif own and 1 / _AS_ASSUMED < rate / own < _AS_ASSUMED:
        fps = own
    else:
        fps = float(f"{rate:.3g}")
    if not own or fps == own or (not assumes and 1 / _AS_ASSUMED < fps / own < _AS_ASSUMED):
        return
    of_own = of_forces = 0.0
    if force.get("start") != "contact":  # there, the shift is not known
        of_own, of_forces = (_fit(part, takes[:_SEEN], one) for one in (own, fps))
    better = of_forces - of_own if max(of_own, of_forces) > SURE else 0.0
    if assumes and better < -_BETTER:
        _say(
            part,
            f"{own} is assumed, as the push in the pictures fits that of the forces by it, though "
            f"these last as long as frames at {fps:g} a second; if that is right, give "
            f"fps: {fps:g}",
        )
    elif assumes:
        part.layout["fps"] = int(fps) if fps.is_integer() else fps
        of = f"all {len(rates)} recordings last" if len(rates) > 1 else "the recording lasts"
        _say(part, f"{fps:g} is assumed, so that {of} as long as the forces")
    elif better > _BETTER:
        part.doubts.append(
            f"fps: {own:.3g} by the films, but forces last as long as frames at {fps:g} a second, "
            f"and the push in the pictures fits theirs by it; if that is right, give fps: {fps:g}"
        )


def _rate_of(film: Path) -> float:
    """Frames a second of a film by its file; 0 for a stack of pictures."""
    frames = open_media(film)
    times = frames.times if isinstance(frames, VideoFrames) else np.zeros(1)
    return (len(times) - 1) / float(times[-1] - times[0]) if len(times) > 1 else 0.0


def _fit(part: Part, takes: Sequence[_Take], fps: float) -> float:
    """Correlation of forces and pictures at a rate, of the worst recording; 0 for still ones."""
    found = []
    for take in takes:
        white = part.layout.get("white")
        frames = (
            open_media(take.files[0], white)
            if "videos" in part.layout
            else ImageFrames(list(take.files), white=white)
        )
        if frames is None or len(take.normal) != len(take.times):
            continue
        chosen = np.unique(np.linspace(0, take.count - 1, _SAMPLES).round().astype(int))
        try:
            pictures = frames.read(chosen.tolist())[:, ::4, ::4].astype(np.float32)
        except TactileForgeError:  # the reader names it
            continue
        change = np.abs(pictures - pictures[0]).mean((1, 2, 3))
        normal = np.abs(np.interp(chosen / fps, take.times, take.normal))
        if np.isfinite(normal).all() and change.std() > 0 and normal.std() > 0:
            found.append(float(np.corrcoef(change, normal)[0, 1]))
    return min(found, default=0.0)


def _say(part: Part, line: str) -> None:
    part.doubts[:] = [f"fps: {line}" if x.startswith("fps:") else x for x in part.doubts]


def _takes(part: Part, family: Family, force: Mapping[str, Any]) -> Iterator[_Take]:
    """The recordings with forces at times of their own."""
    clock = force.get("times")
    if not clock:
        return
    column = clock if isinstance(clock, str) else clock["column"]
    unit = "" if isinstance(clock, str) else clock.get("unit", "")
    for files, count, rows in _tables(family, part.units):
        try:
            table = replace(family, rows=rows)
            values, normal = moments(table, column), numbers(table, force["columns"][2])
        except KeyError:  # of other columns: the reader names it
            continue
        steps = np.diff(values)
        if min(len(values), count) < _LEAST or not (steps > 0).all():
            continue
        date = date_unit(values)
        zero = values[0] if date or "start" in force else 0.0
        second = UNITS[unit or date or "s"]
        yield _Take(files, count, (values - zero) * second, normal)


def _tables(family: Family, units: Units) -> Iterator[tuple[Sequence[Path], int, Cells]]:
    """Files, number of frames and rows of forces of each recording."""
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
        yield files, count, rows
