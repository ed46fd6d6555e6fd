"""The files of one layout become recordings."""

from __future__ import annotations

import re
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tactileforge.contracts import ACTIONS, Frames, FrameSubset, Recording
from tactileforge.data.actions import label_actions
from tactileforge.data.cropped import as_text
from tactileforge.data.frames import VIDEO_SUFFIXES, ImageFrames, VideoFrames
from tactileforge.datasets.layout import FrameTable, Layout, Tile, check_action, check_sensor
from tactileforge.datasets.tables import Row, read_actions, read_force, read_labels, row_of
from tactileforge.errors import ConfigError, DataError, DataNotFoundError

#: Frames of which the median of a recording is taken.
_MEDIAN_FRAMES = 15


@dataclass(frozen=True)
class Touch:
    """One touch before it is opened.

    Attributes:
        name: Its file, or its folder for an image sequence, from the folder of the layout.
        paths: Its files.
        row: What is known of it.
    """

    name: str
    paths: list[Path]
    row: Row


class Reader:
    """Finds, opens and labels the touches of a layout.

    Args:
        layout: What to read.
        root: Folder of the data.

    Raises:
        DataNotFoundError: The folder does not exist.
    """

    def __init__(self, layout: Layout, root: Path) -> None:
        self.layout = layout
        self.folder = root / layout.path
        self._backgrounds: dict[Path, VideoFrames | ImageFrames] = {}
        if not self.folder.is_dir():
            raise DataNotFoundError(
                f"{self.folder}: no such folder; set data.root to the folder that has "
                f"{layout.path!r}, or leave the layout out: data.layouts.{layout.name}=null"
            )

    def touches(self) -> list[Touch]:
        """The touches, in natural order; opens nothing but the labels.

        Raises:
            DataNotFoundError: No file matches.
            DataError: A row of the labels names no file.
        """
        files = _matches(self.folder, self.layout.glob)
        background = self.layout.background
        if background and background.file:
            files = [path for path in files if path != self.folder / background.file]
        if not files:
            raise DataNotFoundError(
                f"{self.folder}: no file matches {self.layout.glob!r}; set data.root to the folder of "
                f"the data, or correct the pattern of layout {self.layout.name!r}"
            )
        if self.layout.each == "sequence":
            grouped = {f: list(paths) for f, paths in groupby(files, key=lambda p: p.parent)}
        else:
            grouped = {path: [path] for path in files}
        named = {path.relative_to(self.folder).as_posix(): grouped[path] for path in grouped}
        labels = read_labels(self.layout, self.folder)
        for name, row in labels.items():
            if name not in named and not (self.folder / name).exists():
                raise DataError(
                    f"{row.where}: {name!r} names no file in {self.folder} (there is, for example, "
                    f"{next(iter(named))!r}); correct the row, or remove it"
                )
        return [Touch(name, paths, row_of(name, labels)) for name, paths in named.items()]

    def frames(self, touch: Touch) -> VideoFrames | ImageFrames:
        """Opens the frames of a touch; decodes nothing.

        Raises:
            DataError: They cannot be read, or the background would take them all.
        """
        if self.layout.each == "video":
            frames: VideoFrames | ImageFrames = VideoFrames(touch.paths[0])
        else:
            frames = ImageFrames(touch.paths)
        background = self.layout.background
        if background and not background.file:
            taken = background.first + background.last
            if len(frames) <= taken:
                raise DataError(
                    f"{touch.paths[0]}: has {len(frames)} frames, all of which would be background"
                )
        return frames

    def recordings(self, touch: Touch, frames: VideoFrames | ImageFrames) -> list[Recording]:
        """Labels a touch: one recording, or one for each tile.

        Raises:
            DataError: Labels contradict the file; names both.
            ConfigError: A label names an unknown sensor or action.
        """
        times = self._times(frames)
        force = action = None
        if self.layout.force:
            path = self._path(self.layout.force.file, touch)
            force = read_force(self.layout.force, path, times)
        action = self._action(touch, times, force)
        layout, row = self.layout, touch.row
        phrases = [row.fill(phrase, spaced=True) for phrase in layout.text]
        shared = Recording(
            key=f"{layout.name}/{touch.name}",
            sensor="",
            frames=frames,
            times=times,
            no_contact=None,
            force=force,
            action=action,
            object=row.fill(layout.object) if layout.object else None,
            text=", ".join(phrase for phrase in phrases if phrase) or None,
            image=self._camera(touch),
            labels={name: _value(cell) for name, cell in row.cells.items() if cell},
            source=layout.source,
            tier=layout.tier,
            licence=layout.licence,
        )
        return [
            _tile(shared, name, tile, self._sensor(tile, touch), self._background(touch, frames))
            for name, tile in self._tiles(frames).items()
        ]
