"""Reader of the files of one layout as recordings."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from copy import copy
from dataclasses import replace
from functools import partial
from itertools import chain, pairwise
from pathlib import Path, PurePosixPath

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
from tactileforge.reading.files import deeper, kind_of, matching_files
from tactileforge.reading.frame_clock import Clocks, FrameClock
from tactileforge.reading.frame_tables import FrameTables
from tactileforge.reading.image_rows import ImageRows
from tactileforge.reading.label_rows import LabelRow, match_labels, row_of_series
from tactileforge.reading.layout import (
    DatasetLayout,
    check_action,
    check_sensor,
)
from tactileforge.reading.layout_keys import MEDIAN_FRAMES, FrameTable
from tactileforge.reading.name_times import name_times
from tactileforge.reading.order import order_doubt
from tactileforge.reading.series import names_of, series_of
from tactileforge.reading.tables import number_or_text
from tactileforge.reading.templates import template_columns
from tactileforge.reading.touch import FileFrames, LayoutTouch, open_files
from tactileforge.reading.trials import TRIAL, trials_of


def join_trials(
    found: Sequence[tuple[LayoutReader, Sequence[LayoutTouch]]],
) -> list[list[tuple[str, str]]]:
    """Layout and name of the trials of the touches of each layout.

    Layouts of one folder share trials, each under the first of them: two sensors of a take may each
    have a layout of their own.

    Args:
        found: Layouts with all their touches.
    """
    trials = [
        [(reader.layout.name, trial) for trial in reader.trials(touches)]
        for reader, touches in found
    ]
    folders: dict[Path, list[tuple[int, int, str]]] = {}
    for of, (reader, touches) in enumerate(found):
        named = zip(touches, reader.names(touches), strict=True)
        for place, (touch, name) in enumerate(named):
            is_only = trials[of][place][1] == touch.name  # of its layout
            if is_only and reader.layout.hold_out == "trial":
                folders.setdefault(reader.folder, []).append((of, place, name))
    for rows in folders.values():
        joined = trials_of([name for *_, name in rows])
        layouts: dict[str, set[int]] = {}
        for (of, *_), trial in zip(rows, joined, strict=True):
            layouts.setdefault(trial, set()).add(of)
        for (of, place, _), trial in zip(rows, joined, strict=True):
            if len(layouts[trial]) > 1:
                trials[of][place] = found[min(layouts[trial])][0].layout.name, trial
    return trials


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
        if not self.folder.is_dir():
            raise DataNotFoundError(
                f"{self.folder}: no such folder; set data.root to the folder of the data, or leave "
                f"the layout out: data.layouts.{layout.name}=null"
            )

    def _of(self, rows: ImageRows) -> None:
        self._clocks, self._tables = Clocks(self.layout, rows), FrameTables(self.layout, rows)

    def touches(self) -> list[LayoutTouch]:
        """The touches, in natural order; reads only the labels.

        Raises:
            DataNotFoundError: No file matches.
            DataError: A row of the labels does not match any file.
            ConfigError: A pattern is invalid.
        """
        files, odd = matching_files(self.folder, self.layout.globs, self.layout.name)
        self.odd += [f"{path}: no file but {kind_of(path)}; left out" for path in odd]
        if not files:
            raise DataNotFoundError(
                f"{self.folder}: no file matches {' or '.join(self.layout.globs)!r}"
                f"{deeper(self.folder, self.layout.globs, self.layout.name)}; set data.root to the "
                f"folder of the data, or correct the pattern of layout {self.layout.name!r}"
            )
        named = self._grouped(files)
        self._of(ImageRows(self.folder, files))
        labels = match_labels(self.layout, self.folder, named)
        touches = [LayoutTouch(name, paths, labels[name]) for name, paths in named.items()]
        if self.layout.each == "sequence" and not self.layout.order:
            touches = [*chain(*map(self._series, touches))]
        if self.layout.films:
            touches = [*chain(*map(self._films, touches))]
        return self._without_backgrounds(touches)

    def again(self) -> LayoutReader:
        """A fresh reader of the same files, for another split."""
        other = copy(self)
        other.tagged = (0, 0)
        return other

    def _grouped(self, files: list[Path]) -> dict[str, list[Path]]:
        """Files of each touch, by its name from the folder of the layout."""
        layout, grouped = self.layout, dict[Path, list[Path]]()
        rows: dict[str, LabelRow] = {}
        if layout.recording:
            each = {path.relative_to(self.folder).as_posix(): [path] for path in files}
            rows = match_labels(replace(layout, each="touch"), self.folder, each)
        for path in files:
            touch = path.parent if layout.each == "sequence" else path
            if layout.recording:
                row = rows[path.relative_to(self.folder).as_posix()]
                group = row.fill(layout.recording)
                if not group:
                    raise DataError(
                        f"{row.where}: no value for recording: {layout.recording!r}; fill it in, "
                        "or move the image out"
                    )
                touch /= group
            grouped.setdefault(touch, []).append(path)
        return {touch.relative_to(self.folder).as_posix(): of for touch, of in grouped.items()}

    def _without_backgrounds(self, touches: list[LayoutTouch]) -> list[LayoutTouch]:
        """Touches without the background images, and without touches left empty."""
        rule = self.layout.background
        if rule is None or rule.file is None:
            return self._in_order(touches)
        # a video may name itself, with the frames in it: one file for all is not a touch
        if self.layout.each == "video" and template_columns(rule.file):
            return touches
        names = {touch.row.fill(rule.file) for touch in touches}
        still = {self.folder / name for name in names if name is not None}
        kept = [
            replace(touch, paths=[path for path in touch.paths if path not in still])
            for touch in touches
        ]
        # the only video may name itself, too
        return self._in_order([touch for touch in kept if touch.paths] or touches)

    def _in_order(self, touches: list[LayoutTouch]) -> list[LayoutTouch]:
        """Touches with their images in the layout's order."""
        if self.layout.each != "sequence":
            return touches
        out = []
        for touch in touches:
            paths = self._clocks.ordered(touch.paths, partial(self._path, touch=touch))
            self._doubt(touch, "" if self.layout.order else order_doubt(paths))
            out.append(replace(touch, paths=paths))
        return out

    def _films(self, touch: LayoutTouch) -> Iterator[LayoutTouch]:
        """The touch of each chosen stream of a video; those of one file are held out together."""
        for name, number in (self.layout.films or {}).items():
            key = f"{touch.name}#{name}" if name else touch.name
            yield replace(touch, name=key, folder=touch.name, stream=number)

    def _series(self, touch: LayoutTouch) -> Iterator[LayoutTouch]:
        """The touch, or one for each series of its folder."""
        found = series_of(touch.paths)
        if len(found) == 1:
            yield touch
            return
        names = [repr(name) for name, paths in found.items() if len(paths) > 1]
        more = ", ..." if len(names) > 3 else ""
        above, slash, _ = self.layout.globs[0].rpartition("/")
        pattern = above + slash + names_of(next(iter(found.values())))
        self._doubt(
            touch,
            f"{len(names)} series of images in one folder, {', '.join(names[:3])}{more}, are each "
            f"taken for a recording; images: {pattern!r} would read only {names[0]}",
        )
        rows = {}
        for name, paths in found.items():
            images = [path.relative_to(self.folder).as_posix() for path in paths]
            rows[name] = row_of_series(touch.row, name, images, self.layout)
        is_one = self._is_one_take([(found[name], rows[name]) for name in found])
        for name, paths in found.items():
            key = f"{touch.name}/{name}".removeprefix("./")
            # sensors of one take, but not takes of one folder, are held out together
            folder = touch.name if is_one and not TRIAL.match(name) else ""
            yield replace(touch, name=key, paths=paths, row=rows[name], folder=folder)

    def _is_one_take(self, series: Sequence[tuple[list[Path], LabelRow]]) -> bool:
        """Whether series may be of one take: of one object, and not one after the other."""
        several = [(paths, row) for paths, row in series if len(paths) > 1]
        if self.layout.object and len({row.fill(self.layout.object) for _, row in several}) > 1:
            return False
        spans = [_span(paths) for paths, _ in several]
        dated = sorted(span for span in spans if span is not None)
        after = [before[1] < first[0] for before, first in pairwise(dated)]
        return len(dated) < len(spans) or not after or not all(after)

    def trials(self, touches: Sequence[LayoutTouch]) -> list[str]:
        """Names of the trials of touches, the held-out units; see `trials.trials_of`.

        Args:
            touches: All touches of the layout.
        """
        names = self.names(touches)
        spans = {}
        for name, touch in zip(names, touches, strict=True):
            if (span := _span(touch.paths)) is not None:
                spans[name] = span
        trials = trials_of(names, spans)
        alone = Counter(trials)
        # a recording without others keeps its own name, whatever words are in it
        return [
            trial if alone[trial] > 1 else touch.name
            for trial, touch in zip(trials, touches, strict=True)
        ]

    def names(self, touches: Sequence[LayoutTouch]) -> list[str]:
        """Names of touches, for telling trials: paths without the endings of files."""
        names = [touch.folder or touch.name for touch in touches]
        if self.layout.each != "sequence":
            names = [str(PurePosixPath(name).with_suffix("")) for name in names]
        return names

    def open(self, touch: LayoutTouch) -> FileFrames:
        """Opens the frames of a touch; decodes nothing.

        Raises:
            DataError: The frames cannot be read, or all of them are background.
        """
        is_film = self.layout.each == "video"
        frames = (
            open_film(touch.paths[0], touch.stream)
            if is_film
            else ImageFrames(touch.paths, index=self.index)
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
        layout, row = self.layout, touch.row
        video = None if isinstance(frames, ImageFrames) else frames
        clock = self._clocks.times(touch.paths, video, partial(self._path, touch=touch))
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
        phrases = [row.fill(phrase, spaced=True) for phrase in layout.text]
        # Common to all tiles; each tile sets its sensor, frames and background below.
        whole = Recording(
            key=f"{layout.name}/{touch.name}",
            sensor="",
            frames=frames,
            times=times,
            no_contact=None,
            force=force,
            action=self._action(touch, times, force),
            object=row.fill(layout.object) if layout.object else None,
            text=", ".join(phrase for phrase in phrases if phrase) or None,
            image=self._camera(touch),
            labels={
                **{
                    name: number_or_text(cell)
                    for name, cell in row.cells.items()
                    if cell and not template_columns(name)
                },
                **({"ignore": " ".join(layout.ignore)} if layout.ignore else {}),
            },
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

    def _path(self, template: str, touch: LayoutTouch) -> Path:
        name = touch.row.fill(template)
        if name is None:
            raise DataError(
                f"{touch.row.where}: a column of {template!r} is empty; fill it in, or remove "
                "the file"
            )
        return self.folder / name

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
        path, note = self._path(table.file, touch), partial(self._doubt, touch)
        named = re.sub(r"\{.*?\}", "*", PurePosixPath(table.file).name)
        if table.partial and not path.exists() and any(self.folder.rglob(named)):
            note(f"has no force: there is no {path.relative_to(self.folder)}")
            return None
        return self._tables.force(table, path, clock, sensor, touch.paths, note, change)

    def _tracked(self, recording: Recording, touch: LayoutTouch, crop: str) -> Recording:
        keys = self.layout.tracks
        if keys is None:
            return recording
        if isinstance(keys, tuple):
            return self._tables.ranged(recording, keys, touch.paths[0])
        path, note = (
            self._path(keys.file.replace("{crop}", crop), touch),
            partial(self._doubt, touch),
        )
        if path.is_file():
            return self._tables.tracked(recording, keys, path, touch.paths, note)
        self._doubt(touch, "has no file of tracks")  # labels by hand grow: said, and no error
        return recording

    def _action(
        self, touch: LayoutTouch, times: NDArray[np.float64], force: NDArray[np.float32] | None
    ) -> NDArray[np.int64] | None:
        action = self.layout.action
        if action is None:
            return None
        if action == "force":
            return None if force is None else label_actions(times, force)
        if isinstance(action, FrameTable):
            path, note = self._path(action.file, touch), partial(self._doubt, touch)
            return self._tables.actions(action, path, len(times), touch.paths, note)
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
        path = self._path(rule.file, touch)
        if path not in self._backgrounds:
            self._backgrounds[path] = open_files([path])
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
    """Keep one of so many frames, with its labels: the rest are copies of it.

    Args:
        recording: The recording.
        every: Stored frames for each frame of the camera, 1 or more; need not be whole.
    """
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


def _span(paths: Sequence[Path]) -> tuple[float, float] | None:
    """Times of the first and last image by dates in their names, s; None without."""
    found = name_times([paths[0].stem, paths[-1].stem], None)
    if found.start is None or found.times is None:
        return None
    start = float(found.start)
    return start, start + float(found.times[-1])
