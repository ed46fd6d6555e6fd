"""Edit lists of MP4 and MOV files: the shown part of the stored frames (ISO 14496-12)."""

from __future__ import annotations

import os
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

#: Largest table of contents that is looked at, bytes: that of `video_index.MAX_FRAMES` frames.
_LARGEST = 1 << 28


def shown_share(path: Path, start: int = 0, size: int | None = None) -> float:
    """Share of a video's duration in its edit list, 0 to 1; 1 without a list.

    A video that was cut without encoding it anew keeps the packets before the cut, and hides them.

    Args:
        path: The file.
        start: Position of its first byte, within another file.
        size: Its bytes; None for all that follow.
    """
    try:
        with path.open("rb") as file:
            end = file.seek(0, os.SEEK_END) if size is None else start + size
            for kind, first, last in boxes(file, start, end):
                if kind == b"moov" and last - first <= _LARGEST:
                    return _of_movie(file, first, last)
    except (OSError, LookupError, ValueError, struct.error):
        pass  # a damaged file is named by its decoder
    return 1.0


def boxes(file: BinaryIO, place: int, end: int) -> Iterator[tuple[bytes, int, int]]:
    """Kind, and first and last byte of the content, of each box."""
    while place + 8 <= end:
        file.seek(place)
        size, kind = struct.unpack(">I4s", file.read(8))
        head = 8
        if size == 1:
            (size,) = struct.unpack(">Q", file.read(8))
            head = 16
        stop = end if size == 0 else place + size
        if (size and size < head) or stop > end:
            raise ValueError(f"box {kind!r} of {size} bytes")
        yield kind, place + head, stop
        place = stop


def _of_movie(file: BinaryIO, first: int, last: int) -> float:
    found = {kind: (a, b) for kind, a, b in boxes(file, first, last) if kind == b"mvhd"}
    movie_scale, _ = _clock(file, found[b"mvhd"][0]) if found else (0, 0)
    for kind, *track in boxes(file, first, last):
        if kind != b"trak":
            continue
        parts = {kind: (a, b) for kind, a, b in boxes(file, *track)}
        if b"mdia" not in parts:
            continue
        media = {kind: (a, b) for kind, a, b in boxes(file, *parts[b"mdia"])}
        if b"hdlr" not in media or _bytes(file, media[b"hdlr"][0] + 8, 4) != b"vide":
            continue
        scale, duration = _clock(file, media[b"mdhd"][0])
        edits = {kind: a for kind, a, _ in boxes(file, *parts.get(b"edts", (0, 0)))}
        if b"elst" not in edits or not (movie_scale and scale and duration):
            return 1.0
        shown = sum(edit for edit, at in _edits(file, edits[b"elst"]) if at >= 0)
        return min(1.0, shown / movie_scale / (duration / scale))
    return 1.0


def _bytes(file: BinaryIO, place: int, count: int) -> bytes:
    file.seek(place)
    return file.read(count)


def _clock(file: BinaryIO, place: int) -> tuple[int, int]:
    """Ticks a second, and duration in ticks, of a header of a movie or media."""
    version = _bytes(file, place, 4)[0]
    if version:
        return struct.unpack(">IQ", _bytes(file, place + 20, 12))
    return struct.unpack(">II", _bytes(file, place + 12, 8))


def _edits(file: BinaryIO, place: int) -> list[tuple[int, int]]:
    """Duration, ticks of the movie, and begin, ticks of the media, of edits; begin -1 for none."""
    version, count = struct.unpack(">B3xI", _bytes(file, place, 8))
    form = ">Qq4x" if version else ">Ii4x"
    count = min(count, 10_000)
    content = _bytes(file, place + 8, count * struct.calcsize(form))
    return [(edit, at) for edit, at in struct.iter_unpack(form, content)]
