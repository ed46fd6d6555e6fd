"""Forces, actions and tracks per frame of a touch, from CSVs by frame, time or image."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from difflib import get_close_matches
from functools import partial
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tactileforge.contracts import Recording
from tactileforge.errors import DataError
from tactileforge.reading.frame_clock import FrameClock
from tactileforge.reading.image_rows import ImageRows, names_images
from tactileforge.reading.layout import DatasetLayout
from tactileforge.reading.layout_keys import FrameTable, TrackKeys, TrackRanges
from tactileforge.reading.name_times import frame_numbers
from tactileforge.reading.order import name_prefix
from tactileforge.reading.table_clock import on_frames
from tactileforge.reading.tables import (
    FoundRows,
    Row,
    as_one_row,
    read_actions,
    read_cells,
    read_force,
    read_tracks,
    whole,
)
from tactileforge.reading.templates import template_columns
from tactileforge.reading.touch import LayoutTouch
from tactileforge.reading.trial_rows import recordings_of


class FrameTables:
    """Reads the tables of a layout for the frames of a touch.

    Args:
        layout: The layout.
        rows: Look-up of CSV rows by image.
    """

    def __init__(self, layout: DatasetLayout, rows: ImageRows) -> None:
        self.layout = layout
        self.rows = rows
        self._shared: dict[tuple[Path, str], dict[Path, list[Row]]] = {}

    def force(
        self,
        table: FrameTable,
        touch: LayoutTouch,
        note: Callable[[str], None],
        clock: FrameClock,
        sensor: str,
        change: Callable[[], NDArray[np.float64]],
    ) -> NDArray[np.float32]:
        """Forces per frame, (T, 3), N; see `tables.read_force`."""
        fit = partial(on_frames, start=clock.start, note=note, change=change)
        path, found = self._found(table, touch, note)
        return read_force(table, path, clock.times, sensor, fit, found)

    def actions(
        self, table: FrameTable, touch: LayoutTouch, note: Callable[[str], None], count: int
    ) -> NDArray[np.int64]:
        """Actions per frame, (T,); see `tables.read_actions`."""
        path, found = self._found(table, touch, note)
        return read_actions(table, path, count, found)

    def tracked(
        self, recording: Recording, keys: TrackKeys, touch: LayoutTouch, note: Callable[[str], None]
    ) -> Recording:
        """The recording with its tracks, without the frames to drop; see `tables.read_tracks`.

        Args:
            recording: Recording of the touch, all frames of it.
            keys: Columns of the values; labels by hand grow, so without their file there are none.
            touch: The touch.
            note: Callback for doubts.

        Raises:
            DataError: Every frame is to be dropped.
        """
        path = touch.path(self.rows.folder, keys.file)
        if not path.is_file():
            note("has no file of tracks")
            return recording
        columns = tuple(dict.fromkeys([*keys.columns, *([keys.drop] if keys.drop else [])]))
        table = FrameTable(keys.file, keys.frame, columns, key=keys.key)
        count = len(recording.times)
        tracks = read_tracks(table, path, count, self._found(table, touch, note)[1])
        recording = replace(recording, tracks={name: tracks[name] for name in keys.columns})
        dropped = np.zeros(count, bool) if keys.drop is None else tracks[keys.drop] > 0
        if dropped.all():
            raise DataError(f"{path}: every frame is dropped ({keys.drop}); remove the recording")
        return recording.select(np.flatnonzero(~dropped).tolist()) if dropped.any() else recording

    def ranged(self, recording: Recording, keys: Sequence[TrackRanges], path: Path) -> Recording:
        """The recording with tracks of 0 and 1 by ranges; NaN within the margin of an edge.

        Raises:
            DataError: Ranges overlap, or exceed the frames of the recording.
        """
        count = len(recording.times)
        tracks = {}
        for track in keys:
            edges = [edge for pair in track.frames for edge in pair]
            if any(b <= a for a, b in pairwise([-1, *edges, count + 1])):
                raise DataError(
                    f"{path}: it has {count} frames, but the ranges of track {track.name!r} in "
                    f"layout {self.layout.name!r} are {[list(pair) for pair in track.frames]}; "
                    "give them in order, apart, and within the frames"
                )
            values = np.zeros(count, np.float32)
            for start, stop in track.frames:
                values[start:stop] = 1
            # the ends of a recording are no edges of a touch
            for edge in {*edges} - {0, count}:
                values[max(0, edge - track.margin) : edge + track.margin] = np.nan
            tracks[track.name] = values
        return replace(recording, tracks=tracks)

    def _found(
        self, table: FrameTable, touch: LayoutTouch, note: Callable[[str], None]
    ) -> tuple[Path, FoundRows]:
        """Path of the table of a touch, and its rows."""
        path = touch.path(self.rows.folder, table.file)
        own = self._of_recording(table, path, touch.paths)
        images = self._images(table, path, touch.paths, note, own)
        is_array = path.suffix.lower() == ".npy" and template_columns(table.file)
        if is_array and self.layout.each == "touch" and images is None and own is None:
            own = as_one_row(read_cells(path, []))
        return path, FoundRows(images, own)

    def _images(
        self,
        table: FrameTable,
        path: Path,
        paths: Sequence[Path],
        note: Callable[[str], None],
        own: Sequence[Row] | None,
    ) -> Mapping[int, Row] | None:
        """Rows by frame of a table with names or numbers of images; None for other tables."""
        if table.frame and self.layout.each == "sequence" and self.layout.times != "even":
            return _numbered(table, path, [one.stem for one in paths], note, own)
        if own is not None and self.layout.each == "touch":
            beside = [image for image in self.rows.images if image.parent == paths[0].parent]
            stems = [image.stem for image in beside]
            found = _numbered(table, path, stems, note, own)
            if found is None:
                found = {}
                for where, cells in own:
                    if not (cell := whole(cells[str(table.frame)])).isdecimal():
                        raise DataError(
                            f"{where}: frame {cell!r} is not a whole number; correct it"
                        )
                    found[int(cell)] = where, cells
            row = found.get(beside.index(paths[0]))
            return {} if row is None else {0: row}
        if table.frame or table.time or self.layout.each == "video":
            return None
        is_shared = not template_columns(table.file)
        is_stills = self.layout.each == "touch" and (is_shared or names_images(path))
        # without a key, a column with a usual name tells the images of stills alone: in a table a
        # recording, it may be anything
        if table.key is None and not is_stills:
            return None
        columns = [name for name in table.columns if name]
        return self.rows.find(path, table.key, columns, paths, is_shared)

    def _of_recording(
        self, table: FrameTable, path: Path, paths: Sequence[Path]
    ) -> list[Row] | None:
        """Rows of the recording in a table with its name; None for other tables."""
        if not table.key or not (table.frame or table.time):
            return None
        own = self._place(paths[0])
        if (path, table.key) not in self._shared:
            needed = [*table.columns, table.key, table.frame or table.time]
            rows = read_cells(path, [name for name in needed if name])
            names = {
                place.relative_to(self.rows.folder).as_posix(): place
                for place in dict.fromkeys(map(self._place, self.rows.images))
            }
            written = [cells[table.key] for _, cells in rows]
            told: Mapping[str, Sequence[str]] = {}
            if template_columns(table.file):  # those beside the table are meant first
                inner = self.rows.folder != path.parent and own.is_relative_to(path.parent)
                above = path.parent if inner else own.parent
                near = [name for name, one in names.items() if one.is_relative_to(above)]
                told = recordings_of(written, near)
            if not told.keys() >= {*written}:
                told = {**recordings_of(written, [*names]), **told}
            grouped: dict[Path, list[Row]] = {}
            for where, cells in rows:
                if cells[table.key] not in told:
                    alike = get_close_matches(cells[table.key], [*names], 1) or [*names][:1]
                    raise DataError(
                        f"{where}: {table.key} {cells[table.key]!r} names no recording, or several "
                        f"(one that there is: {alike[0]!r}); correct the row, or remove it"
                    )
                for name in told[cells[table.key]]:
                    grouped.setdefault(names[name], []).append((where, cells))
            self._shared[path, table.key] = grouped
        return self._shared[path, table.key].get(own, [])

    def _place(self, image: Path) -> Path:
        """Path of the recording of a file, as rows may name it."""
        if self.layout.each == "video":
            return image
        is_prefix = self.layout.recording == "{prefix}"
        return image.parent / (name_prefix(image.stem) if is_prefix else "")


def _numbered(
    table: FrameTable,
    path: Path,
    stems: Sequence[str],
    note: Callable[[str], None],
    rows: Sequence[Row] | None = None,
) -> Mapping[int, Row] | None:
    """Rows by frame of a table with the numbers in the names of images; None if it counts images.

    Rows of numbers between those of the first and last image are of dropped frames, and left out;
    so are those after the last of a table with `partial`.
    """
    assert table.frame is not None
    numbers, counts = frame_numbers(stems), range(len(stems))
    if not numbers or numbers == list(counts):
        return None
    if rows is None:
        rows = read_cells(path, [*(name for name in table.columns if name), table.frame])
    cells = [whole(row[table.frame]) for _, row in rows]
    written = {int(cell): row for cell, row in zip(cells, rows, strict=True) if cell.isdecimal()}
    if len(written) < len(rows):  # no numbers, or one twice: `read_force` and the like name it
        return None
    is_counted = all(number in counts for number in written)
    last = max(written) if table.partial and written else numbers[-1]
    wrong = [number for number in written if not numbers[0] <= number <= last]
    if wrong and not is_counted:
        raise DataError(
            f"{written[wrong[0]][0]}: frame {wrong[0]} does not exist, names of images have "
            f"{numbers[0]} to {numbers[-1]}; remove the row, or give the CSV of this recording"
        )
    # a row for each image, numbered with no regard to holes, was written by counting
    if wrong or (is_counted and len(written) == len(counts)):
        return None
    if is_counted:
        note(
            f"{path.name}: {table.frame!r} is taken for the numbers in names ({stems[0]!r} is "
            f"{numbers[0]}); if it counts images from 0, say times: even"
        )
    places = {number: place for place, number in enumerate(numbers)}
    return {places[number]: row for number, row in written.items() if number in places}
