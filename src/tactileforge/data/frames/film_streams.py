"""Number of video streams of a file, by its header: OpenCV shows the first and hides the rest."""

from __future__ import annotations

import os
import re
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

from tactileforge.data.frames.mp4_edits import boxes
from tactileforge.util.regular import check_regular

#: Header of an AVI's stream of video (AVISTREAMHEADER): strh, its size, and the kind of stream.
_AVI = re.compile(rb"strh.{4}vids", re.DOTALL)
#: Bytes in which the headers of an AVI lie.
_AVI_HEAD = 1 << 20
#: Elements of Matroska (RFC 9559): the segment, its tracks, one of them, and its kind.
_SEGMENT, _TRACKS, _TRACK, _KIND = 0x18538067, 0x1654AE6B, 0xAE, 0x83


def count_streams(path: str | Path) -> int:
    """Number of video streams of an AVI, MP4, MOV, Matroska or WebM; 1 where it cannot be told.

    Args:
        path: The file; only headers are read.
    """
    try:
        check_regular(path)
        with Path(path).open("rb") as file:
            head = file.read(12)
            end = file.seek(0, os.SEEK_END)
            if head[:4] == b"RIFF":
                file.seek(0)
                return max(len(_AVI.findall(file.read(_AVI_HEAD))), 1)
            if head[:4] == b"\x1a\x45\xdf\xa3":
                return max(_of_matroska(file, end), 1)
            if head[4:8] in (b"ftyp", b"moov", b"mdat", b"wide", b"free", b"skip"):
                return max(_of_movie(file, end), 1)
    except (OSError, ValueError, IndexError, struct.error):
        pass  # a damaged file is named by its decoder
    return 1


def _of_movie(file: BinaryIO, end: int) -> int:
    count = 0
    for kind, *movie in boxes(file, 0, end):
        for name, *track in boxes(file, *movie) if kind == b"moov" else ():
            for part, *media in boxes(file, *track) if name == b"trak" else ():
                for last, place, _ in boxes(file, *media) if part == b"mdia" else ():
                    if last == b"hdlr":
                        file.seek(place + 8)  # version, flags, and four bytes of QuickTime
                        count += file.read(4) == b"vide"
    return count


def _of_matroska(file: BinaryIO, end: int) -> int:
    for name, *segment in _elements(file, 0, end):
        for part, *tracks in _elements(file, *segment) if name == _SEGMENT else ():
            if part == _TRACKS:
                return sum(
                    _is_film(file, *of) for one, *of in _elements(file, *tracks) if one == _TRACK
                )
    return 0


def _is_film(file: BinaryIO, first: int, last: int) -> bool:
    for name, place, _ in _elements(file, first, last):
        if name == _KIND:
            file.seek(place)
            return file.read(1) == b"\1"
    return False


def _elements(file: BinaryIO, place: int, end: int) -> Iterator[tuple[int, int, int]]:
    """Number, and first and last byte of the content, of each element of EBML (RFC 8794)."""
    while place < end:
        file.seek(place)
        head = file.read(12)
        name = 8 - head[0].bit_length()  # bytes after the first one
        size = 8 - head[name + 1].bit_length()
        if name > 3 or size > 7:
            raise ValueError(f"no element of EBML at byte {place}")
        length = int.from_bytes(head[name + 1 : name + size + 2]) & ((1 << 7 * (size + 1)) - 1)
        start = place + name + size + 2
        # all ones: of a length that a live recorder did not know
        stop = end if length == (1 << 7 * (size + 1)) - 1 else start + length
        yield int.from_bytes(head[: name + 1]), start, min(stop, end)
        place = stop
