"""A touch of a layout before it is opened, and what belongs to it beside its frames."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias

from tactileforge.data.frames.lazy import VIDEO_SUFFIXES, ImageFrames, VideoFrames
from tactileforge.datasets.reading.files import DamagedFileError
from tactileforge.datasets.reading.label_rows import LabelRow
from tactileforge.errors import DataError, DataNotFoundError

FileFrames: TypeAlias = VideoFrames | ImageFrames


@dataclass(frozen=True)
class LayoutTouch:
    """One touch before it is opened.

    Attributes:
        name: Its file, or its folder for an image sequence, from the folder of the layout.
        paths: Its files.
        row: What is known of it.
    """

    name: str
    paths: list[Path]
    row: LabelRow


def open_files(paths: list[Path]) -> FileFrames:
    """Opens what belongs to a touch beside its frames: its background, or its camera view.

    Args:
        paths: A video, or images.

    Raises:
        DataNotFoundError: A file does not exist.
        DamagedFileError: One cannot be read.
    """
    is_video = len(paths) == 1 and paths[0].suffix.lower() in VIDEO_SUFFIXES
    try:
        return VideoFrames(paths[0]) if is_video else ImageFrames(paths)
    except DataNotFoundError:
        raise
    except DataError as error:
        raise DamagedFileError(str(error)) from error
