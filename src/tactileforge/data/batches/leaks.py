"""Leaks: recordings in the training split of one source and the validation split of another."""

from __future__ import annotations

import hashlib
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence

from tactileforge.contracts import Frames, Recording
from tactileforge.data.batches.sources import Source
from tactileforge.errors import DataError

#: Validation recordings to check, and training recordings to compare each with; two frames of each
#: are decoded, so a check costs seconds at most.
_LOOKED, _COMPARED = 32, 64
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

    A few recordings are compared bit by bit, at their first and last frame. Pictures of a single
    level are ignored.

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
    known: dict[int, bytes | None] = {}
    found = []
    for source, one in held_out[::step]:
        for other in _candidates(one, source, alike[_size(one)]):
            digest = _digest(one.frames)
            if id(other) not in known:
                known[id(other)] = _digest(other.frames)
            if digest is not None and digest == known[id(other)]:
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


def _candidates(
    one: Recording, source: int, alike: Sequence[tuple[int, Recording]]
) -> Iterator[Recording]:
    """Recordings of other sources, first those with the same key within their source."""
    others = [other for number, other in alike if number != source]
    name = one.key.partition("/")[2]
    same = [other for other in others if other.key.partition("/")[2] == name]
    step = max(1, -(-len(others) // _COMPARED))
    # one folder given to two sources is the usual mistake, and leaves the keys as they are
    yield from same[:_COMPARED]
    yield from others[::step]


def _digest(frames: Frames) -> bytes | None:
    """Hash of the first and last frame; None for unreadable or blank ones."""
    try:
        pixels = frames.read([0, len(frames) - 1])
    except DataError:
        return None
    # black frames of two broken recordings are equal without being a leak
    if int(pixels.max()) - int(pixels.min()) < 2:
        return None
    return hashlib.blake2b(pixels.tobytes(), digest_size=16).digest()
