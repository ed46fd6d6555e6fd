"""Bytes behind the end of an AVI file: FFmpeg searches them one by one."""

from __future__ import annotations

import os
from pathlib import Path

#: Sizes of a file that was never finished.
_UNKNOWN = (0, 0xFFFFFFFF)


def avi_tail(path: Path, start: int = 0, size: int | None = None) -> int:
    """Bytes behind the last part of an AVI; 0 for another file, or one without a size.

    Args:
        path: The file.
        start: Position of its first byte, within another file.
        size: Its bytes; None for all that follow.
    """
    try:
        with path.open("rb") as file:
            end = file.seek(0, os.SEEK_END) if size is None else start + size
            at = start
            while at + 8 <= end:
                file.seek(at)
                head = file.read(8)
                length = int.from_bytes(head[4:], "little")
                if head[:4] != b"RIFF":
                    break
                if length in _UNKNOWN:
                    return 0
                at += 8 + length + length % 2
            return max(0, end - at) if at > start else 0
    except OSError:  # its decoder says so
        return 0
