"""Forces, actions and tracks per frame of a touch, from CSVs by frame, time or image."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
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
from tactileforge.reading.table_clock import on_frames
from tactileforge.reading.tables import Row, read_actions, read_force, read_tracks
from tactileforge.reading.templates import template_columns


class FrameTables:
    """Reads the tables of a layout for the frames of a touch.

    Args:
        layout: The layout.
        rows: Look-up of CSV rows by image.
    """

    def __init__(self, layout: DatasetLayout, rows: ImageRows) -> None:
        self.layout = layout
        self.rows = rows

    def force(
        self,
        table: FrameTable,
        path: Path,
        clock: FrameClock,
        sensor: str,
        paths: Sequence[Path],
        note: Callable[[str], None],
    ) -> NDArray[np.float32]:
        """Forces per frame, (T, 3), N; see `tables.read_force`.

        Args:
            table: Columns of the forces.
            path: Path of the CSV.
            clock: Times of the frames.
            sensor: Name of the measuring sensor.
            paths: Files of the touch.
            note: Callback for doubts, see `table_clock.on_frames`.
        """
        fit = partial(on_frames, start=clock.start, note=note)
        return read_force(table, path, clock.times, sensor, fit, self._images(table, path, paths))

    def actions(
        self, table: FrameTable, path: Path, count: int, paths: Sequence[Path]
    ) -> NDArray[np.int64]:
        """Actions per frame, (T,); see `tables.read_actions`.

        Args:
            table: Column of the actions.
            path: Path of the CSV.
            count: Number of frames.
            paths: Files of the touch.
        """
        return read_actions(table, path, count, self._images(table, path, paths))

    def tracked(
        self, recording: Recording, keys: TrackKeys, path: Path, paths: Sequence[Path]
    ) -> Recording:
        """The recording with its tracks, without the frames to drop; see `tables.read_tracks`.

        Args:
            recording: Recording of the touch, all frames of it.
            keys: Columns of the values.
            path: Path of the CSV.
            paths: Files of the touch.

        Raises:
            DataError: Every frame is to be dropped.
        """
        columns = tuple(dict.fromkeys([*keys.columns, *([keys.drop] if keys.drop else [])]))
        table = FrameTable(keys.file, keys.frame, columns, key=keys.key)
        count = len(recording.times)
        found = read_tracks(table, path, count, self._images(table, path, paths))
        recording = replace(recording, tracks={name: found[name] for name in keys.columns})
        dropped = np.zeros(count, bool) if keys.drop is None else found[keys.drop] > 0
        if dropped.all():
            raise DataError(f"{path}: every frame is dropped ({keys.drop}); remove the recording")
        return recording.select(np.flatnonzero(~dropped).tolist()) if dropped.any() else recording

    def ranged(self, recording: Recording, keys: Sequence[TrackRanges], path: Path) -> Recording:
        """The recording with tracks of 0 and 1 by ranges; NaN within the margin of an edge.

        Args:
            recording: Recording of the touch, all frames of it.
            keys: Ranges of each track.
            path: File of the touch, for errors.

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

    def _images(
        self, table: FrameTable, path: Path, paths: Sequence[Path]
    ) -> Mapping[int, Row] | None:
        """Rows by frame for a table with image names; None for another kind of table."""
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
