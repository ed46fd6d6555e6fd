"""Leaks: recordings in the training split of one source and the validation split of another."""

from __future__ import annotations

import hashlib
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import chain

import cv2
import numpy as np
from numpy.typing import NDArray

from tactileforge.contracts import Recording
from tactileforge.data.batches.sources import Source
from tactileforge.data.frames.small import ELSEWHERE, SIMILAR
from tactileforge.errors import DataError

#: Validation recordings to check, and training recordings to compare each with; four frames of each
#: are decoded, so a check costs seconds at most.
_LOOKED, _COMPARED = 32, 256
#: Training recordings of the same source to compare each with: copies within one are rarer.
_COMPARED_WITHIN = 64
#: Size of small pictures.
_SMALL = (32, 24)
#: Smallest change from the first frame, grey levels, and share of the pixels with it: pictures
#: without touch look alike.
_TOUCH, _TOUCHED = 8.0, 0.02
#: Leaks named by the warning.
_NAMED = 4


def group_by_source(
    sources: Mapping[str, Sequence[Source]],
    train: Sequence[list[Recording]],
    val: Sequence[list[Recording]],
) -> tuple[list[list[Recording]], list[list[Recording]]]:
    """Group training and validation recordings by source, in one order.

    Args:
        sources: Sources of ``train`` and ``val``; a source may be in one of them alone.
        train: Training recordings of each source, in that order.
        val: Validation recordings of each source, in that order.
    """
    found: dict[str, tuple[list[Recording], list[Recording]]] = {}
    for side, (split, opened) in enumerate((("train", train), ("val", val))):
        for source, recordings in zip(sources[split], opened, strict=True):
            found.setdefault(source.name, ([], []))[side].extend(recordings)
    return [of[0] for of in found.values()], [of[1] for of in found.values()]


def find_leaks(
    train: Sequence[Sequence[Recording]], val: Sequence[Sequence[Recording]]
) -> list[tuple[str, str]]:
    """Find training and validation recordings of two sources with the same pictures, by key.

    A few recordings are compared bit by bit, at their first and last frame. Copies that were
    encoded again are found by small pictures of frames in between, if these show a touch. Pictures
    of a single level are ignored.

    Args:
        train: Training recordings of each source.
        val: Validation recordings of the same sources, in the same order.
    """
    if len(train) < 2:
        return []
    held_out = [(source, one) for source, of in enumerate(val) for one in of]
    step = max(1, -(-len(held_out) // _LOOKED))
    alike: dict[tuple[int, tuple[int, int]], list[tuple[int, Recording]]] = defaultdict(list)
    for source, recordings in enumerate(train):
        for one in recordings:
            alike[_size(one)].append((source, one))
    known: dict[int, _Look | None] = {}
    found = []
    for source, one in held_out[::step]:
        mine = None
        others = [other for number, other in alike[_size(one)] if number != source]
        # one folder given to two sources is the usual mistake, and leaves the keys as they are
        name = one.key.partition("/")[2]
        same = [other for other in others if other.key.partition("/")[2] == name]
        spread = others[:: max(1, -(-len(others) // _COMPARED))]
        for other in chain(same[:_COMPARED], spread):
            # decoded only where there is something to compare with
            mine = mine or _look(one)
            if mine is None:
                break
            if id(other) not in known:
                known[id(other)] = _look(other)
            theirs = known[id(other)]
            if theirs is not None and mine.is_same(theirs):
                found.append((other.key, one.key))
                break
    return found


def find_copies(train: Sequence[Recording], val: Sequence[Recording]) -> list[tuple[str, str]]:
    """Find held-out recordings with the pictures of a training one, by key; as `find_leaks`.

    Args:
        train: Training recordings; those of other lengths and sizes than a held-out one are no
            copies of it.
        val: Held-out recordings.
    """
    alike: dict[tuple[int, tuple[int, int]], list[Recording]] = defaultdict(list)
    for one in train:
        alike[_size(one)].append(one)
    known: dict[int, _Look | None] = {}
    found = []
    for one in val[:: max(1, -(-len(val) // _LOOKED))]:
        others = alike[_size(one)]
        mine = _look(one) if others else None
        for other in others[:: max(1, -(-len(others) // _COMPARED_WITHIN))] if mine else ():
            if id(other) not in known:
                known[id(other)] = _look(other)
            theirs = known[id(other)]
            if theirs is not None and mine is not None and mine.is_same(theirs):
                found.append((other.key, one.key))
                break
    return found


def leak_warning(found: Sequence[tuple[str, str]]) -> str:
    """Format a warning with the names of some leaks.

    Args:
        found: Result of `find_leaks`, at least one leak.
    """
    named = ", ".join(f"{ours} and {theirs}" for ours, theirs in found[:_NAMED])
    more = f", and {len(found) - _NAMED} more" if len(found) > _NAMED else ""
    return (
        "one source trains on what another validates on, so validation says nothing of new data: "
        f"{named}{more} show the same pictures; give each folder to one source"
    )


def _size(one: Recording) -> tuple[int, tuple[int, int]]:
    return len(one.frames), one.frames.shape


@dataclass(frozen=True)
class _Look:
    """Pictures of a recording, reduced for comparison.

    Attributes:
        digest: Hash of the first and last frame.
        small: int16 (n, h, w, 3), small frames in between; None if they show no touch.
    """

    digest: bytes
    small: NDArray[np.int16] | None

    def is_same(self, other: _Look) -> bool:
        """Whether both show the same pictures, at most encoded again."""
        if self.digest == other.digest:
            return True
        if self.small is None or other.small is None or self.small.shape != other.small.shape:
            return False
        return bool((np.abs(self.small - other.small) > SIMILAR).mean() < ELSEWHERE)


def _look(one: Recording) -> _Look | None:
    """Pictures of a recording for comparison; None for unreadable or blank ones."""
    last = len(one.frames) - 1
    try:
        # thirds between the ends, which may be at rest in all recordings
        pixels = one.frames.read([0, last // 3, 2 * last // 3, last])
        first = one.background() if last == 0 else pixels[0]
    except DataError:
        return None
    ends = pixels[[0, -1]]
    # black frames of two broken recordings are equal without being a leak
    if int(ends.max()) - int(ends.min()) < 2:
        return None
    small = _small([pixels[0]] if last == 0 else pixels[1:])
    is_touched = (
        first is not None
        and first.shape == pixels.shape[1:]
        and ((np.abs(small - _small([first])) > _TOUCH).mean() > _TOUCHED)
    )
    digest = hashlib.blake2b(ends.tobytes(), digest_size=16).digest()
    return _Look(digest, small if is_touched else None)


def _small(pictures: Sequence[NDArray[np.uint8]] | NDArray[np.uint8]) -> NDArray[np.int16]:
    # in colours: lights of three sides cancel in their mean, and faint imprints with them
    small = [cv2.resize(one, _SMALL, interpolation=cv2.INTER_AREA) for one in pictures]
    return np.round(small).astype(np.int16)
