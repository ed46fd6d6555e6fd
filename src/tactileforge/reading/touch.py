"""Unopened touches of a layout, and opening of their backgrounds and camera views."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias

from tactileforge.data.frames.lazy import VIDEO_SUFFIXES, ImageFrames, VideoFrames
from tactileforge.data.frames.picture_index import PictureIndex
from tactileforge.data.frames.stacks import StackFrames, is_stack, open_film
from tactileforge.errors import DataError, DataNotFoundError
from tactileforge.reading.files import DamagedFileError
from tactileforge.reading.label_rows import LabelRow

FileFrames: TypeAlias = VideoFrames | StackFrames | ImageFrames


@dataclass(frozen=True)
class LayoutTouch:
    """One touch before it is opened.

    Attributes:
        name: Path of its file, or of its folder for an image sequence, from the layout's folder.
        paths: Paths of its files.
        row: Labels of the touch.
        folder: Name of the folder of several series, or of the file of several streams, which are
            held out together; "" for others.
        stream: Number of the stream of video.
        frame: The only frame of a film; None for all of its frames.
    """

    name: str
    paths: list[Path]
    row: LabelRow
    folder: str = ""
    stream: int = 0
    frame: int | None = None

    def path(self, folder: Path, template: str) -> Path:
        """A path for the touch by a template.

        Raises:
            DataError: One of the columns is empty.
        """
        name = self.row.fill(template)
        if name is None:
            raise DataError(
                f"{self.row.where}: a column of {template!r} is empty; fill it in, or remove the "
                "file"
            )
        return folder / name


def open_files(
    paths: list[Path], index: PictureIndex | None = None, white: float | None = None
) -> FileFrames:
    """Opens a background or a camera view of a touch.

    Raises:
        DataNotFoundError: A file does not exist.
        DamagedFileError: A file cannot be read.
    """
    alone = paths[0] if len(paths) == 1 else None
    is_film = alone and (alone.suffix.lower() in VIDEO_SUFFIXES or is_stack(alone))
    try:
        if is_film:
            return open_film(paths[0], white=white)
        return ImageFrames(paths, index=index, white=white)
    except DataNotFoundError:  # a slip of the layout, which is no damage of one touch
        raise
    except DataError as error:
        raise DamagedFileError(str(error)) from error
