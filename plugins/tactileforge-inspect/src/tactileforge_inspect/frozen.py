"""Stretches of identical frames, found from a few of them."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from tactileforge.contracts import Recording

#: Frames decoded at once, and in all on each side of a repeated frame.
_CHUNK, _MOST = 8, 480


def digest_of(frame: NDArray[np.uint8]) -> bytes:
    """Hash of the pixels of a frame."""
    return hashlib.blake2b(frame.tobytes(), digest_size=16).digest()


def frozen_time(recording: Recording, rows: Sequence[int], digests: Sequence[bytes]) -> float:
    """Longest time of identical frames around some, s.

    A frame that equals the next one is followed to both sides; so a freeze that is longer than the
    distance of the frames is measured to the frame.

    Args:
        recording: The recording.
        rows: Frame numbers, ascending.
        digests: Their hashes, see `digest_of`.

    Raises:
        DataError: A frame cannot be decoded.
    """
    count, times = len(recording.frames), recording.times
    nexts = [row + 1 for row in rows if row + 1 < count]
    after: dict[int, bytes] = {}
    for at in range(0, len(nexts), _CHUNK):
        chunk = nexts[at : at + _CHUNK]
        after |= dict(zip(chunk, map(digest_of, recording.frames.read(chunk)), strict=True))
    longest, reached = 0.0, -1
    for row, digest in zip(rows, digests, strict=True):
        # within a run that was followed already
        if row <= reached or after.get(row + 1) != digest:
            continue
        reached = _follow(recording, digest, range(row + 1, min(count, row + _MOST)))
        first = _follow(recording, digest, range(row, max(-1, row - _MOST), -1))
        longest = max(longest, float(times[reached] - times[first]))
    return longest


def _follow(recording: Recording, digest: bytes, rows: range) -> int:
    """Last of the rows with frames identical to the first."""
    last = rows[0]
    for at in range(1, len(rows), _CHUNK):
        chunk = rows[at : at + _CHUNK]
        # ascending, which a video reads without going back
        frames = recording.frames.read(sorted(chunk))
        for row, frame in zip(chunk, frames if rows.step > 0 else frames[::-1], strict=True):
            if digest_of(frame) != digest:
                return last
            last = row
    return last
