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
        case VideoFrames():
            return [_changed(frames.path), list(frames.box)]
        case StackFrames():
            return [_changed(frames.path), list(frames.box), *_white(frames)]
        case ImageFrames():
            changed = [_changed(path) for path in frames.paths]
            return [changed, list(frames.box), *_white(frames)]
        case TurnedFrames():
            stamp = [stamp_of(frames.base), frames.bgr, frames.turns]
            # shards that were packed before there was a mirror keep their stamp
            return [*stamp, frames.mirror] if frames.mirror else stamp
        case PackedFrames():
            return frames.crcs.tolist()
    return None


def _white(frames: StackFrames | ImageFrames) -> list[float]:
    """White of pictures of 16 bits; [] for others, whose stamps stay as they were."""
    return [frames.white] if frames.white else []


def _changed(path: str) -> tuple[str, int, int]:
    # by name alone: data that was moved as a whole is still the same
    stat = Path(path).stat()
    return Path(path).name, stat.st_size, stat.st_mtime_ns
