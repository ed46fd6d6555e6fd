"""Reader of the files of one layout as recordings."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from copy import copy
from dataclasses import replace
from functools import partial
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactileforge.contracts import ACTIONS, Frames, FrameSubset, Recording
from tactileforge.data.frames.crop import check_background_size
from tactileforge.data.frames.cut import spread_rows
from tactileforge.data.frames.film_streams import count_streams
from tactileforge.data.frames.lazy import Crop, ImageFrames
from tactileforge.data.frames.picture_index import PictureIndex
from tactileforge.data.frames.small import shrink
from tactileforge.data.frames.stacks import open_film
from tactileforge.data.labels.actions import label_actions
from tactileforge.errors import DataError, DataNotFoundError
from tactileforge.reading.files import matching_files
from tactileforge.reading.found_touches import FoundTouches
from tactileforge.reading.frame_clock import Clocks, FrameClock
from tactileforge.reading.frame_tables import FrameTables
from tactileforge.reading.image_rows import ImageRows
from tactileforge.reading.label_rows import LabelRow
from tactileforge.reading.layout import DatasetLayout, check_action, check_sensor
from tactileforge.reading.layout_keys import MEDIAN_FRAMES, FrameTable
from tactileforge.reading.tables import number_or_text
from tactileforge.reading.templates import template_columns
from tactileforge.reading.touch import FileFrames, LayoutTouch, open_files


class LayoutReader:
    """Finds, opens and labels the touches of a layout.

    Args:
        layout: The layout.
        root: Folder of the data.

    Attributes:
        odd: One line for each match of a pattern other than a file; filled by `touches`.
        doubts: Names of doubtful touches, each with the doubt as a phrase.
        tagged: Numbers of opened images with an EXIF orientation, and of all.
        index: Headers of images, of this start and of earlier ones.

    Raises:
        DataNotFoundError: The folder does not exist.
    """

    def __init__(self, layout: DatasetLayout, root: Path) -> None:
        self.layout = layout
        self.folder = root / layout.path
        self.odd: list[str] = []
        self.doubts: list[tuple[str, str]] = []
        self.tagged = (0, 0)
        self.index = PictureIndex(self.folder)
        self._of(ImageRows(self.folder, []))
        self._backgrounds: dict[Path, FileFrames] = {}
        #: The film of single touches that was read last, whole.
        self._film: tuple[LayoutTouch, list[Recording]] | None = None
        if not self.folder.is_dir():
            raise DataNotFoundError(
                f"{self.folder}: no such folder; set data.root to the folder of the data, or leave "
                f"the layout out: data.layouts.{layout.name}=null"
            )

    def _of(self, rows: ImageRows) -> None:
        self._clocks, self._tables = Clocks(self.layout, rows), FrameTables(self.layout, rows)

    def touches(self) -> list[LayoutTouch]:
        """The touches, in natural order; see `found_touches.FoundTouches`."""
        found = FoundTouches(self.layout, self.folder, self.doubts)
        self.odd += found.odd
        rows = ImageRows(self.folder, found.files)
        self._of(rows)
        return found.touches(rows)

    def again(self) -> LayoutReader:
        """A fresh reader of the same files, for another split."""
        other = copy(self)
        other.tagged = (0, 0)
        return other

    def open(self, touch: LayoutTouch) -> FileFrames:
        """Opens the frames of a touch; decodes nothing.

        Raises:
            DataError: The frames cannot be read, or all of them are background.
        """
        is_film = self.layout.each == "video"
        frames = (
            open_film(touch.paths[0], touch.stream, self.layout.white)
            if is_film
            else ImageFrames(touch.paths, index=self.index, white=self.layout.white)
        )
        background = self.layout.background
        least = 0 if background is None or background.file else background.first + background.last
        if background is not None and background.frames and not background.file:
            least = background.frames[0]
        if background and not background.file and len(frames) <= least:
            raise DataError(
                f"{touch.paths[0]}: {len(frames)} frames, all of them background; remove the file, "
                f"or give layout {self.layout.name!r} another background"
            )
        if isinstance(frames, ImageFrames):
            self.tagged = (self.tagged[0] + frames.tagged, self.tagged[1] + len(frames))
        return frames

    def label(self, touch: LayoutTouch, frames: FileFrames) -> Iterator[Recording]:
        """Yields the recording of an open touch, or one for each tile.

        Raises:
            DataNotFoundError: A file of labels, the background or a camera view is missing.
            DamagedFileError: The background or a camera view cannot be read.
            DataError: Labels or the background contradict the frames.
            ConfigError: A label names an unknown sensor or action.
        """
        if touch.frame is None:
            yield from self._label(touch, frames)
            return
        film = self._film
        if film is None or (film[0].paths, film[0].stream) != (touch.paths, touch.stream):
            self._film = film = touch, [*self._label(touch, frames)]
        for whole in film[1]:
            one = replace(
                whole.select([touch.frame]),
                key=whole.key.replace(film[0].name, touch.name, 1),
                times=np.zeros(1),
                **self._words(touch.row),
            )
            if self.layout.action == "force" and one.force is not None:
                one = replace(one, action=label_actions(one.times, one.force))
            yield one

    def _label(self, touch: LayoutTouch, frames: FileFrames) -> Iterator[Recording]:
        layout, row = self.layout, touch.row
        video = None if isinstance(frames, ImageFrames) else frames
        clock = self._clocks.times(touch.paths, video, partial(touch.path, self.folder))
        self._doubt(touch, clock.doubt)
        if layout.labels and not row.cells:
            self._doubt(touch, f"has no row in {layout.labels}")
        if video and layout.films is None and (count := count_streams(touch.paths[0])) > 1:
            self._doubt(
                touch,
                f"has {count} streams of video, of which the first is read; stream: 1 reads the "
                "next, stream: {left: 0, right: 1} both",
            )
        times = clock.times
        background = self._background(touch, frames)
        full = (0, 0, frames.full_shape[1], frames.full_shape[0])
        change = partial(_change, frames, self._no_contact(frames, background, full))
        force = self._force(touch, clock, change)
        # Common to all tiles; each tile sets its sensor, frames and background below.
        whole = Recording(
            key=f"{layout.name}/{touch.name}",
            sensor="",
            frames=frames,
            times=times,
            no_contact=None,
            force=force,
            action=self._action(touch, times, force),
            image=self._camera(touch),
            **self._words(row),
            source=layout.source,
            tier=layout.tier,
            licence=layout.licence,
        )
        tiles = {f"#{name}": (tile.box, tile.sensor) for name, tile in layout.crops.items()}
        for name, (box, sensor) in (tiles or {"": (full, layout.sensor or "")}).items():
            shown = frames.crop(box)
            tile = replace(
                whole,
                key=whole.key + name,
                sensor=self._sensor(sensor, touch),
                frames=layout.stream.upright(shown),
                no_contact=self._no_contact(shown, background, box),
            )
            yield thinned(self._tracked(tile, touch, name), layout.every)

    def _words(self, row: LabelRow) -> dict[str, Any]:
        """What a row says of its touch."""
        layout = self.layout
        phrases = [row.fill(phrase, spaced=True) for phrase in layout.text]
        labels = {
            name: number_or_text(cell)
            for name, cell in row.cells.items()
            if cell and not template_columns(name)
        }
        return {
            "object": row.fill(layout.object) if layout.object else None,
            "text": ", ".join(phrase for phrase in phrases if phrase) or None,
            "labels": labels | ({"ignore": " ".join(layout.ignore)} if layout.ignore else {}),
        }

    def _sensor(self, template: str, touch: LayoutTouch) -> str:
        name = touch.row.fill(template)
        if name is None:
            raise DataError(f"{touch.row.where}: no sensor; fill in the column of {template!r}")
        check_sensor(name, touch.row.where)
        return name

    def _doubt(self, touch: LayoutTouch, doubt: str) -> None:
        if doubt:
            self.doubts.append((touch.name, doubt))

    def _force(
        self, touch: LayoutTouch, clock: FrameClock, change: Callable[[], NDArray[np.float64]]
    ) -> NDArray[np.float32] | None:
        table = self.layout.force
        if table is None:
            return None
        if isinstance(table.start, str) and template_columns(table.start):
            name, where = touch.row.fill(table.start), touch.row.where
            started = number_or_text(name or "")
            if isinstance(started, str):
                raise DataError(
                    f"{where}: start: {table.start!r} of force is {name!r}; give the time of the "
                    f"first frame by the clock of {table.time!r}"
                )
            table = replace(table, start=started)
        felt_by = [self.layout.sensor, *(tile.sensor for tile in self.layout.crops.values())]
        sensor = self._sensor(next(name for name in felt_by if name), touch)
        note = partial(self._doubt, touch)
        path = touch.path(self.folder, table.file)
        named = re.sub(r"\{.*?\}", "*", PurePosixPath(table.file).name)
        if table.partial and not path.exists() and any(self.folder.rglob(named)):
            note(f"has no force: there is no {path.relative_to(self.folder)}")
            return None
        return self._tables.force(table, touch, note, clock, sensor, change)

    def _tracked(self, recording: Recording, touch: LayoutTouch, crop: str) -> Recording:
        keys = self.layout.tracks
        if keys is None:
            return recording
        if isinstance(keys, tuple):
            return self._tables.ranged(recording, keys, touch.paths[0])
        file = keys.file.replace("{crop}", crop)
        return self._tables.tracked(
            recording, replace(keys, file=file), touch, partial(self._doubt, touch)
        )

    def _action(
        self, touch: LayoutTouch, times: NDArray[np.float64], force: NDArray[np.float32] | None
    ) -> NDArray[np.int64] | None:
        action = self.layout.action
        if action is None:
            return None
        if action == "force":
            return None if force is None else label_actions(times, force)
        if isinstance(action, FrameTable):
            return self._tables.actions(action, touch, partial(self._doubt, touch), len(times))
        actions = np.full(len(times), -1, np.int64)
        if isinstance(action, str):
            for frame, row in self._rows(touch, action):
                if name := row.fill(action):
                    check_action(name, row.where)
                    actions[frame] = ACTIONS.index(name)
            return actions
        for part in action:
            if not 0 <= part.start < part.stop <= len(times):
                raise DataError(
                    f"{touch.paths[0]}: it has {len(times)} frames, but layout "
                    f"{self.layout.name!r} gives an action to [{part.start}, {part.stop}]"
                )
            actions[part.start : part.stop] = ACTIONS.index(part.action)
        return actions

    def _rows(self, touch: LayoutTouch, template: str) -> Iterator[tuple[int | slice, LabelRow]]:
        """Frames with the row for a template: rows of images for columns mixed within the touch."""
        if not set(template_columns(template)) & set(touch.row.mixed):
            yield slice(None), touch.row
            return
        for frame, path in enumerate(touch.paths):
            row = touch.row.images.get(path.relative_to(self.folder).as_posix())
            if row is not None:
                yield frame, row

    def _background(self, touch: LayoutTouch, frames: FileFrames) -> FileFrames | None:
        """The background file, opened once; None without one."""
        rule = self.layout.background
        if rule is None or rule.file is None:
            return None
        path = touch.path(self.folder, rule.file)
        if path not in self._backgrounds:
            self._backgrounds[path] = open_files([path], white=self.layout.white)
        background = self._backgrounds[path]
        other = str(touch.paths[0])
        check_background_size(background.full_shape, frames.full_shape, str(path), other)
        if not isinstance(background, ImageFrames) and not (rule.first + rule.last or rule.frames):
            raise DataError(f"{path}: a video as background: say which frames with first or last")
        return background

    def _no_contact(self, shown: FileFrames, file: FileFrames | None, box: Crop) -> Frames | None:
        rule = self.layout.background
        if rule is None:
            return None
        base = file.crop(box) if file else shown
        rows = rule.rows(len(base))
        return FrameSubset(self.layout.stream.upright(base), rows)

    def _camera(self, touch: LayoutTouch) -> Frames | None:
        pattern = touch.row.fill(self.layout.camera) if self.layout.camera else None
        if pattern is None:
            return None
        files, _ = matching_files(self.folder, [pattern], self.layout.name)
        if not files:
            raise DataNotFoundError(
                f"{self.folder}: no camera view of {touch.name} matches {pattern!r}; add it, or "
                f"correct image of layout {self.layout.name!r}"
            )
        return open_files(files, self.index)


def thinned(recording: Recording, every: float) -> Recording:
    """Keep one of so many frames, with its labels: the rest are copies of it."""
    count = len(recording.frames)
    if every <= 1 or count < 2:
        return recording
    # the middle of the stretch of each frame of the camera: copies lie on both sides of it
    rows = ((np.arange(np.ceil(count / every)) + 0.5) * every).astype(int)
    return recording.select([int(row) for row in np.unique(rows) if row < count])


def _change(frames: FileFrames, no_contact: Frames | None) -> NDArray[np.float64]:
    """Mean difference of each frame from the background, or else from the median, grey levels."""
    shown = no_contact if no_contact is not None else frames
    still = np.median(
        [shrink(shown.read([row])[0]) for row in spread_rows(len(shown), MEDIAN_FRAMES)], axis=0
    )
    # one at a time: a recording need not fit into memory
    return np.array(
        [float(np.abs(shrink(frames.read([row])[0]) - still).mean()) for row in range(len(frames))]
    )
