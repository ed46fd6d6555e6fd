"""Stamps of frames on disk, to notice changed files."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from tactileforge.contracts import Frames, FrameSubset
from tactileforge.data.frames.image_codecs import PackedFrames
from tactileforge.data.frames.lazy import ImageFrames, VideoFrames
from tactileforge.data.frames.stacks import StackFrames
from tactileforge.data.frames.turned import TurnedFrames


def stamp_of(frames: Frames | None) -> Any:
    """Stamp of frames: names, sizes and times of change of files, crops and rows; decodes nothing.

    Returns:
        Plain data for JSON; None for frames of unknown kind.
    """
    match frames:
        case FrameSubset():
            return [[int(row) for row in frames.rows], stamp_of(frames.base)]
        case VideoFrames() if frames.stream:
            return [_changed(frames.path), list(frames.box), frames.stream]
        case VideoFrames() | StackFrames():
            return [_changed(frames.path), list(frames.box)]
        case ImageFrames():
            return [[_changed(path) for path in frames.paths], list(frames.box)]
        case TurnedFrames():
            stamp = [stamp_of(frames.base), frames.bgr, frames.turns]
            # shards that were packed before there was a mirror keep their stamp
            return [*stamp, frames.mirror] if frames.mirror else stamp
        case PackedFrames():
            return frames.crcs.tolist()
    return None


def _changed(path: str) -> tuple[str, int, int]:
    # by name alone: data that was moved as a whole is still the same
    stat = Path(path).stat()
    return Path(path).name, stat.st_size, stat.st_mtime_ns
