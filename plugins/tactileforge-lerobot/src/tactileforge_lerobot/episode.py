"""Simultaneous recordings on the rows of one episode."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactileforge.contracts import Frames, FrameSubset, Recording
from tactileforge.data import nearest
from tactileforge.errors import DataError
from tactileforge.specs import spec
from tactileforge_lerobot import folder


@dataclass(frozen=True)
class AlignedRows:
    """Simultaneous recordings.

    Attributes:
        parts: Recording of each device, by its name.
        rows: Index of the frame of each row, int64 (N,), by device.
        dropped: Number of frames outside of all rows, by device.
    """

    parts: dict[str, Recording]
    rows: dict[str, NDArray[np.int64]]
    dropped: dict[str, int]

    def __len__(self) -> int:
        return len(next(iter(self.rows.values())))

    @property
    def seen(self) -> tuple[str, Recording]:
        """Device and recording with the camera image of the episode; the first one if none has."""
        with_image = (item for item in self.parts.items() if item[1].image is not None)
        return next(with_image, next(iter(self.parts.items())))

    @property
    def task(self) -> str:
        """Description of the task in words."""
        first = next(iter(self.parts.values()))
        words = first.text or (f"touch the {first.object}" if first.object else "touch")
        return re.sub(r"\s+", " ", words.replace("{action}", "touch")).strip()


def device_word(recording: Recording) -> str:
    """Name of a recording's sensor in the names of features."""
    labels = recording.labels
    name = str(labels.get("device", labels.get("finger", recording.sensor)))
    return re.sub(r"[^A-Za-z0-9_]+", "_", name)


def episode_rate(recordings: Iterable[Recording]) -> int:
    """Frames per second of the fastest recording, as a whole number.

    Raises:
        DataError: No recording has two frames.
    """
    steps = [recording.period for recording in recordings if len(recording.times) > 1]
    if not steps:
        raise DataError("a recording of one frame has no rate: give fps=...")
    return max(1, round(1 / min(steps)))


def group_takes(recordings: Iterable[Recording]) -> Iterator[list[Recording]]:
    """Groups recordings by take or episode, one per device; unlabelled ones are alone.

    Raises:
        DataError: The recordings of an episode do not follow one another.
    """

    def made(numbered: tuple[int, Recording]) -> Any:
        number, recording = numbered
        labels = recording.labels
        if "episode" in labels:
            return labels["episode"], recording.source
        if "take" in labels:
            return labels["take"], labels.get("begun"), recording.source
        return number

    done = set()
    for which, group in groupby(enumerate(recordings), made):
        by_device: dict[str, list[Recording]] = {}
        if which in done:
            raise DataError(
                f"recordings of episode {which[0]} do not follow one another; pack each source "
                "alone, with its keys as they are"
            )
        done.add(which)
        for _, recording in group:
            by_device.setdefault(device_word(recording), []).append(recording)
        for number in range(max(map(len, by_device.values()))):
            yield [parts[number] for parts in by_device.values() if number < len(parts)]


def robot_part(parts: Iterable[Recording], track: str) -> Recording | None:
    """First recording of an episode with a track of the robot, or None."""
    return next((part for part in parts if track in part.tracks), None)


def _known_span(recordings: Sequence[Recording]) -> tuple[float, float]:
    """First and last time with known state and actions of the robot, s.

    Raises:
        DataError: They are unknown everywhere, or somewhere in between.
    """
    start, end = -np.inf, np.inf
    for track in folder.ROBOT:
        part = robot_part(recordings, track)
        if part is None:
            continue
        known = np.isfinite(part.tracks[track].reshape(len(part.times), -1)).all(1)
        rows = np.flatnonzero(known)
        if not len(rows) or not known[rows[0] : rows[-1] + 1].all():
            raise DataError(
                f"{part.key}: {track} is not a number in {int((~known).sum())} of {len(known)} "
                "rows; leave the recording out, or cut it where the robot was not read"
            )
        start, end = max(start, part.times[rows[0]]), min(end, part.times[rows[-1]])
    return float(start), float(end)


def episode(recordings: Sequence[Recording], fps: float) -> AlignedRows:
    """Puts recordings on common rows; each row has the frame nearest to its time.

    Raises:
        DataError: They do not overlap in time, or state or actions of the robot are unknown in
            between.
    """
    first, last = _known_span(recordings)
    start = max(first, *(float(recording.times[0]) for recording in recordings))
    end = min(last, *(float(recording.times[-1]) for recording in recordings))
    if end < start:
        keys = " and ".join(recording.key for recording in recordings)
        raise DataError(
            f"{keys} belong to one take but do not overlap in time; leave out a sensor with "
            "devices=[...]"
        )
    due = start + np.arange(int((end - start) * fps + 0.5) + 1) / fps
    parts, rows, dropped = {}, {}, {}
    for recording in recordings:
        name = device_word(recording)
        after = np.searchsorted(recording.times, due).clip(1, max(1, len(recording.times) - 1))
        if len(recording.times) == 1:
            after = np.ones(len(due), np.int64)
        before = after - 1
        later = recording.times[np.minimum(after, len(recording.times) - 1)]
        nearer = np.abs(later - due) < np.abs(due - recording.times[before])
        rows[name] = np.where(nearer, np.minimum(after, len(recording.times) - 1), before)
        parts[name] = recording
        dropped[name] = len(recording.times) - len(np.unique(rows[name]))
    return AlignedRows(parts, rows, dropped)


def episode_features(shown: AlignedRows, images: str) -> dict[str, dict[str, Any]]:
    """Declares the features of an episode, without `folder.COMMON`.

    Args:
        shown: The episode.
        images: ``video``; ``png``; ``auto``: arrays of taxels as png, as each pixel is a value, all
            others as video; or ``camera``: the paired camera alone.
    """
    declared: dict[str, dict[str, Any]] = {}
    for track, feature in folder.ROBOT.items():
        source = robot_part(shown.parts.values(), track)
        if source is not None:
            size = int(np.prod(source.tracks[track].shape[1:], dtype=int))
            declared[feature] = _numbers("float32", size, [f"{track}_{i}" for i in range(size)])
    for name, part in shown.parts.items():
        lossless = images == "png" or (images == "auto" and spec(part.sensor).kind == "array")
        if images != "camera":
            declared[f"observation.images.{name}"] = _picture(part.frames.shape, lossless)
        declared[f"observation.time.{name}"] = _numbers("float64", 1, ["seconds"])
        if part.force is not None:
            declared[f"observation.force.{name}"] = _numbers("float32", 3, ["x", "y", "z"])
        if part.action is not None:
            declared[f"observation.touch.{name}"] = _numbers("int64", 1, ["action"])
        for track, values in part.tracks.items():
            if values.dtype.kind in "biuf" and track not in folder.ROBOT:
                size = int(np.prod(values.shape[1:], dtype=int))
                kind = "float32" if values.dtype == np.float32 else "float64"
                declared[f"observation.{track}.{name}"] = _numbers(kind, size, None)
    _, first = shown.seen
    if first.image is not None:
        declared["observation.images.camera"] = _picture(first.image.shape, images == "png")
    return declared


def _picture(shape: tuple[int, int], lossless: bool) -> dict[str, Any]:
    height, width = shape if lossless else (n + n % 2 for n in shape)
    return {
        "dtype": "image" if lossless else "video",
        "shape": [height, width, 3],
        "names": ["height", "width", "channels"],
    }


def _numbers(dtype: str, size: int, names: list[str] | None) -> dict[str, Any]:
    return {"dtype": dtype, "shape": [size], "names": names}


def number_rows(shown: AlignedRows, feature: str) -> NDArray[Any]:
    """Rows of a numeric feature, (N, size)."""
    for track, name in folder.ROBOT.items():
        source = robot_part(shown.parts.values(), track)
        if feature == name and source is not None:
            rows = shown.rows[device_word(source)]
            return source.tracks[track][rows].reshape(len(rows), -1)
    _, kind, name = feature.split(".", 2)
    part, rows = shown.parts[name], shown.rows[name]
    known: dict[str, Any] = {"time": part.times, "force": part.force, "touch": part.action}
    values = known[kind] if kind in known else part.tracks[kind]
    return np.asarray(values)[rows].reshape(len(rows), -1)


def image_rows(shown: AlignedRows, feature: str) -> Frames:
    """Rows of an image feature, as they were recorded; read on demand."""
    name = feature.removeprefix("observation.images.")
    if name in shown.parts:
        return FrameSubset(shown.parts[name].frames, shown.rows[name].tolist())
    name, first = shown.seen
    assert first.image is not None
    if first.image_times is None:
        chosen = shown.rows[name] * len(first.image) // len(first.frames)
    else:
        chosen = nearest(first.image_times, first.times[shown.rows[name]])
    return FrameSubset(first.image, chosen.tolist())
