"""Touch recordings as zarr of version 2 in the format of FTP-1 (Open X-Tactile)."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactileforge.contracts import Recording
from tactileforge.errors import ConfigError, DataError, unknown
from tactileforge.plugins import new_part

#: Rows of a chunk of pictures, and of one of numbers.
_PICTURES, _NUMBERS = 16, 4096
#: Names of sensors in files of FTP-1.
_NAMES = {"gelsight_mini": "GelSightMini", "digit": "DIGIT", "gelsight": "GelSight"}
_NAMES |= {"duragel": "DuraGel", "gelslim": "GelSlim"}
#: Characters of a text.
_TEXT = 200


def write_zarr(
    recordings: Iterable[Recording], out: Path, side: str = "right"
) -> dict[str, tuple[int, int]]:
    """Writes a group for each sensor, size of its frames and set of labels.

    Each recording is an episode of one pad.

    Args:
        recordings: Recordings in any order.
        out: Folder of the groups, ``SENSOR_WIDTHxHEIGHT.zarr``; it must not exist.
        side: ``right`` or ``left``, the hand in the names of arrays.

    Returns:
        Episodes and rows of each group.

    Raises:
        ConfigError: The folder exists, or the side is unknown.
        DataError: There are no recordings.
    """
    if side not in ("right", "left"):
        raise ConfigError(unknown("side", side, ("right", "left")))
    if out.exists():
        raise ConfigError(f"{out} exists: give another out=, or remove it")
    groups: dict[str, _Group] = {}
    with new_part(out) as part:
        part.mkdir()
        for recording in recordings:
            name = _name(recording)
            if name not in groups:
                groups[name] = _Group(part / name, recording, side)
            groups[name].add(recording)
        if not groups:
            raise DataError("there are no recordings to write; look at data=")
        for group in groups.values():
            group.finish()
        part.replace(out)
    return {name: (len(group.ends), group.ends[-1]) for name, group in groups.items()}


def _name(recording: Recording) -> str:
    height, width = recording.frames.shape
    words = [recording.sensor, f"{width}x{height}"]
    words += ["force"] if recording.force is not None else []
    if recording.image is not None:
        words.append("camera_{1}x{0}".format(*recording.image.shape))
    return re.sub(r"\W+", "_", "_".join(words)) + ".zarr"


class _Group:
    """A growing group, written episode by episode."""

    def __init__(self, path: Path, first: Recording, side: str) -> None:
        import zarr

        self.root = zarr.open_group(str(path), mode="w", zarr_format=2)
        self.ends: list[int] = []
        data = f"data/{side}_tactile"
        self.touch = self._array(f"{data}_data_gripper", np.uint8, (1, *first.frames.shape, 3))
        self.area = self._array(f"{data}_area_gripper", np.int64, (1,))
        self.sensor = self._array(f"{data}_sensor_gripper", np.dtype("<U32"), ())
        self.kind = self._array(f"{data}_type_gripper", np.dtype("<U8"), ())
        self.times = self._array("data/timestamps", np.float64, ())
        self.text = self._array("data/sub_task_instruction", np.dtype(f"<U{_TEXT}"), ())
        self.force = self.force_kind = self.camera = None
        if first.force is not None:
            self.force = self._array(f"{data}_data_force", np.float32, (1, 3))
            self.force_kind = self._array(f"{data}_type_force", np.dtype("<U8"), ())
        if first.image is not None:
            self.camera = self._array("data/camera_main_rgb", np.uint8, (*first.image.shape, 3))

    def _array(self, name: str, dtype: Any, shape: tuple[int, ...]) -> Any:
        rows = _PICTURES if len(shape) > 2 else _NUMBERS
        return self.root.create_array(
            name, shape=(0, *shape), dtype=dtype, chunks=(rows, *shape), fill_value=None
        )

    def add(self, recording: Recording) -> None:
        """Adds a recording as an episode."""
        start = self.ends[-1] if self.ends else 0
        count = len(recording.frames)
        words = (recording.text or "").replace("{action}", "touch")[:_TEXT]
        _append(self.times, start, recording.times - recording.times[0])
        _append(self.area, start, np.zeros((count, 1), np.int64))
        _append(self.sensor, start, np.full(count, _NAMES.get(recording.sensor, recording.sensor)))
        _append(self.kind, start, np.full(count, "image"))
        _append(self.text, start, np.full(count, words))
        if recording.force is not None:
            _append(self.force, start, recording.force[:, None])
            _append(self.force_kind, start, np.full(count, "state"))
        self.touch.resize((start + count, *self.touch.shape[1:]))
        # whole chunks at once: a chunk is packed again for each write to it
        for rows in _blocks(start, count):
            frames = recording.frames.read([row - start for row in rows])
            self.touch[rows[0] : rows[-1] + 1] = frames[:, None]
        if self.camera is not None and recording.image is not None:
            self.camera.resize((start + count, *self.camera.shape[1:]))
            views = _views(recording)
            for rows in _blocks(start, count):
                chosen = [int(views[row - start]) for row in rows]
                self.camera[rows[0] : rows[-1] + 1] = recording.image.read(chosen)
        self.ends.append(start + count)

    def finish(self) -> None:
        """Writes the ends of the episodes."""
        ends = np.array(self.ends, np.int64)
        array = self.root.create_array(
            "meta/episode_ends", shape=ends.shape, dtype=ends.dtype, chunks=ends.shape
        )
        array[:] = ends


def _blocks(start: int, count: int) -> Iterator[list[int]]:
    """Rows of an episode, chunk by chunk."""
    rows = iter(range(start, start + count))
    first = _PICTURES - start % _PICTURES
    block = [*islice(rows, first)]
    while block:
        yield block
        block = [*islice(rows, _PICTURES)]


def _append(array: Any, start: int, values: NDArray[Any]) -> None:
    array.resize((start + len(values), *array.shape[1:]))
    array[start:] = values


def _views(recording: Recording) -> NDArray[np.int64]:
    """The camera view of each frame: the nearest in time, or spread evenly."""
    assert recording.image is not None
    count = len(recording.frames)
    if recording.image_times is None:
        return np.arange(count) * len(recording.image) // count
    after = np.searchsorted(recording.image_times, recording.times)
    after = after.clip(1, max(1, len(recording.image_times) - 1))
    later = recording.image_times[np.minimum(after, len(recording.image_times) - 1)]
    is_before = recording.times - recording.image_times[after - 1] <= later - recording.times
    return np.where(is_before, after - 1, np.minimum(after, len(recording.image_times) - 1))
