"""Merges segments of a take into one recording per sensor, copying encoded images."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactileforge.contracts import Recording
from tactileforge.data import LazyImages, Packed, PackedFrames, describe_recording, read_shard


def merge_segments(paths: Sequence[Path]) -> list[Packed]:
    """Merges the recordings of several segments into one per sensor.

    Args:
        paths: Files of the segments of one take, in order.

    Raises:
        DataError: A segment is damaged.
    """
    by_sensor: dict[str, list[Recording]] = {}
    for path in paths:
        for recording in read_shard(path):
            by_sensor.setdefault(recording.key.rpartition("/")[0], []).append(recording)
    return [_one(key, parts) for key, parts in by_sensor.items()]


def _one(key: str, parts: Sequence[Recording]) -> Packed:
    first, last = parts[0], parts[-1]
    frames = [_packed(part.frames) for part in parts]
    views = [_packed(part.image) for part in parts if part.image is not None]
    seen = [part.image_times for part in parts if part.image_times is not None]
    # a track that one segment lacks would be shorter than the frames
    tracks = {
        name: np.concatenate([part.tracks[name] for part in parts])
        for name in first.tracks
        if all(name in part.tracks for part in parts)
    }
    # of the last segment, as counters of dropped frames grow over the take
    labels = {name: value for name, value in last.labels.items() if name != "segment"}
    whole = replace(
        first,
        key=key,
        times=np.concatenate([part.times for part in parts]),
        force=_column([part.force for part in parts]),
        action=_column([part.action for part in parts]),
        image_times=np.concatenate(seen) if seen else None,
        labels=labels,
        tracks=tracks,
    )
    return Packed(
        describe_recording(whole),
        frames[0].codec,
        _encoded(frames),
        _encoded([_packed(first.no_contact)] if first.no_contact is not None else []),
        _encoded(views),
    )


def _column(parts: Sequence[NDArray[Any] | None]) -> Any:
    known = [part for part in parts if part is not None]
    return np.concatenate(known) if len(known) == len(parts) else None


def _packed(frames: Any) -> PackedFrames:
    assert isinstance(frames, PackedFrames)  # they come from a shard
    return frames


def _encoded(parts: Sequence[PackedFrames]) -> LazyImages:
    """Encoded images of several recordings, read one by one."""
    places = [(part, number) for part in parts for number in range(len(part))]
    return LazyImages(len(places), lambda place: places[place][0].encoded(places[place][1]))
