"""Clips of recordings: their index, and their decoding."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, ClassVar, TypeAlias

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch.utils.data import Dataset

from tactileforge.contracts import NEUTRAL_BACKGROUND, Batch, Frames, Recording
from tactileforge.data.batches.columns import CutColumns
from tactileforge.data.frames.cut import frame_period, held_clips, whole_clips
from tactileforge.data.frames.pixel_contract import checked_pixels
from tactileforge.data.labels import displacement
from tactileforge.data.labels.align import nearest
from tactileforge.data.labels.objects import object_id
from tactileforge.data.labels.upright import is_upright
from tactileforge.errors import ConfigError, DataError
from tactileforge.specs.published import spec

#: Unreadable data by name: a line with the reason, and the number of recordings lost.
Skipped: TypeAlias = dict[str, tuple[str, int]]
#: Consecutive unreadable recordings before reading gives up.
_MAX_FAILURES = 20
#: Ratio of sizes from which frames are averaged. Below it, bilinear interpolation still reads every
#: pixel, and is six times as fast.
AVERAGED_FROM = 1.5


class Clips(Dataset[dict[str, Any]]):
    """All clips of a set of recordings.

    A clip is cut by time: ``frames`` frames, ``spacing`` seconds apart, rounded to whole frames of
    the recording (every second frame at 30 Hz and every frame at 18 Hz for 1/15 s). At a varying
    rate, the frames nearest to these times are taken (see `data.frames.cut`). Clips across a gap in
    time are left out. A recording shorter than a clip repeats its first frame.

    The index is two integers a clip; frames are read, resized to ``size`` and kept in a cache of
    bounded size, so memory does not grow with the number of recordings.

    Args:
        recordings: Recordings to cut.
        frames: Frames of a clip.
        spacing: Seconds between the frames of a clip.
        hop: Seconds between the ends of neighbouring clips; at least one frame.
        size: Height and width of the resized frames, pixels.
        image_size: Height and width of the resized camera image, pixels.
        cache_mb: Megabytes of resized frames kept in each process.
        columns: Extra columns of the rows; None for none.

    Attributes:
        recordings: The recordings.
        scales: Force scale along x, y and z, N, by sensor.
        strides: int32 (recordings,), frames from one frame of a clip to the next.
        provides: Further keys of a row, for data sets with clips of their own.
        facts: Plain data for heads, by name.
        is_touch: Whether a row is one touch, as the report shows them.

    Raises:
        ConfigError: A recording names an unknown sensor.
        DataError: There is nothing to cut.
    """

    provides: frozenset[str] = frozenset()
    facts: Mapping[str, Any] = {}
    is_touch: ClassVar[bool] = True

    def __init__(
        self,
        recordings: Iterable[Recording],
        frames: int,
        spacing: float,
        hop: float,
        size: tuple[int, int],
        image_size: int = 96,
        cache_mb: float = 512,
        columns: CutColumns | None = None,
    ) -> None:
        self.columns = columns
        self.recordings = list(recordings)
        self.frames = frames
        self.size = size
        self.image_size = image_size
        self.scales = {name: spec(name).force_scale for name in self.sensors}
        self._cache = _Cache(int(cache_mb * 2**20))
        self.spacing = spacing
        self.strides = np.zeros(len(self.recordings), np.int32)
        self._periods = np.zeros(len(self.recordings))
        ends = []
        for i, recording in enumerate(self.recordings):
            self.strides[i], self._periods[i], rows = _cut(recording.times, frames, spacing, hop)
            ends.append(np.stack([np.full(len(rows), i), rows], axis=1))
        self.index = np.concatenate(ends).astype(np.int32) if ends else np.zeros((0, 2), np.int32)
        if not len(self.index):
            raise DataError("the data set has no recording from which a clip can be cut")

    @property
    def sensors(self) -> list[str]:
        """Names of the sensors, sorted."""
        return sorted({recording.sensor for recording in self.recordings})

    def __len__(self) -> int:
        return len(self.index)

    def rows(self, clip: int) -> NDArray[np.int64]:
        """Frame numbers of a clip within its recording, oldest first."""
        number, end = self.index[clip]
        if (period := float(self._periods[number])) == 0:
            rows = _strided(end, self.frames, self.strides[number])
        else:
            times = self.recordings[number].times
            (rows,) = held_clips(times, [end], self.frames, self.spacing, period)
        return rows

    def labels(self) -> tuple[NDArray[np.int64], NDArray[np.str_], NDArray[np.int64]]:
        """Object, sensor and action of every clip, (n,) each; -1 unknown. Decodes nothing."""
        objects = np.array([object_id(r.object) for r in self.recordings])
        sensor = np.array([r.sensor for r in self.recordings])
        action = np.array([self._action(clip) for clip in range(len(self))])
        which = self.index[:, 0]
        return objects[which], sensor[which], action

    def _action(self, clip: int) -> int:
        action = self.recordings[self.index[clip, 0]].action
        if action is None:
            return -1
        shown = action[self.rows(clip)]
        return int(shown[-1]) if (shown == shown[-1]).all() else -1

    def __getitem__(self, item: int | tuple[int, int]) -> dict[str, Any]:
        """Read a clip, or one of the next readable recording.

        Args:
            item: Number of the clip, or that number and its matching group.

        Returns:
            One row of a batch (see `tactileforge.contracts`); for ``skipped`` see `Skipped`.

        Raises:
            DataError: Too many consecutive recordings are unreadable.
        """
        clip, group = item if isinstance(item, tuple) else (item, -1)
        skipped: Skipped = {}
        for _ in range(_MAX_FAILURES):
            try:
                return self._read(clip, group) | {"skipped": skipped}
            except DataError as error:
                broken = self.recordings[self.index[clip, 0]].key
                skipped[broken] = str(error), 1
                # a fixed substitute, not a random one: a resumed run reads the same clip; it has no
                # group, since its partner in the pair shows another object
                following = np.searchsorted(self.index[:, 0], self.index[clip, 0], side="right")
                clip, group = int(following) % len(self), -1
        first, _ = next(iter(skipped.values()))
        raise DataError(f"{_MAX_FAILURES} recordings in a row cannot be read; first: {first}")

    def _read(self, clip: int, group: int) -> dict[str, Any]:
        number = int(self.index[clip, 0])
        recording, rows = self.recordings[number], self.rows(clip)
        force = np.full((self.frames, 3), np.nan, np.float32)
        if recording.force is not None:
            force = recording.force[rows]
        height, width = self.image_size, self.image_size
        image = np.zeros((height, width, 3), np.uint8)
        if recording.image is not None:
            row = view_of(recording, int(rows[-1]))
            image = self._frames(("image", number), recording.image, [row], (height, width))[0]
        # unlabelled values are zeros with a mask: a batch has the same keys and shapes whatever its
        # sources label, so compiled graphs stay and ranks agree
        surface = np.full((self.frames, *displacement.SHAPE, 3), displacement.NONE, np.uint8)
        if recording.surface is not None:
            size = displacement.SHAPE
            surface = self._frames(("surface", number), recording.surface, rows.tolist(), size)
        return {
            "frames": _tensor(
                self._frames(("touch", number), recording.frames, rows.tolist(), self.size)
            ),
            "background": _tensor(self._background(number)),
            "sensor": recording.sensor,
            "force": torch.from_numpy(np.nan_to_num(force)),
            "force_valid": torch.from_numpy(np.isfinite(force).all(axis=0)),
            "force_scale": torch.tensor(self.scales[recording.sensor]),
            "action": self._action(clip),
            "object": object_id(recording.object),
            "text": recording.text or "",
            "image": _tensor(image),
            "image_valid": recording.image is not None,
            "surface": _tensor(surface),
            "surface_valid": recording.surface is not None,
            "group": group,
            "aspect": recording.frames.shape[1] / recording.frames.shape[0],
            "upright": is_upright(recording),
            "clip": clip,
            **(self.columns.cut(recording, rows) if self.columns else {}),
        }

    def _background(self, number: int) -> NDArray[np.uint8]:
        recording = self.recordings[number]
        background = self._cache.get(("background", number))
        if background is None:
            rest = recording.background()
            if rest is None:
                background = np.full((*self.size, 3), NEUTRAL_BACKGROUND, np.uint8)
            elif rest.shape[:2] != tuple(recording.frames.shape):
                raise DataError(
                    f"{recording.key}: the background is {rest.shape[:2]}, the frames are "
                    f"{recording.frames.shape}; give a background of the same size"
                )
            else:
                rest = checked_pixels(rest, f"{recording.key}, background", 3)
                background = resize_frame(rest, self.size)
            self._cache.put(("background", number), background)
        return background

    def _frames(
        self, key: tuple[str, int], frames: Frames, rows: Sequence[int], size: tuple[int, int]
    ) -> NDArray[np.uint8]:
        found = {row: self._cache.get((*key, row)) for row in rows}
        missing = [row for row, frame in found.items() if frame is None]
        if missing:
            read = checked_pixels(frames.read(missing), f"{self.recordings[key[1]].key}, {key[0]}")
            for row, frame in zip(missing, read, strict=True):
                found[row] = small = resize_frame(frame, size)
                self._cache.put((*key, row), small)
        return np.stack([found[row] for row in rows])  # type: ignore[misc]


class _Cache:
    """Least-recently-used cache of arrays, up to a number of bytes."""

    def __init__(self, limit: int) -> None:
        self.limit = limit
        self.size = 0
        self.items: OrderedDict[Any, NDArray[np.uint8]] = OrderedDict()

    def get(self, key: Any) -> NDArray[np.uint8] | None:
        if key in self.items:
            self.items.move_to_end(key)
            return self.items[key]
        return None

    def clear(self, kind: str) -> None:
        """Drop the arrays of a kind, the first word of their keys."""
        for key in [key for key in self.items if key[0] == kind]:
            self.size -= self.items.pop(key).nbytes

    def put(self, key: Any, array: NDArray[np.uint8]) -> None:
        self.items[key] = array
        self.size += array.nbytes
        # also the array just put may go: one larger than the limit must not stay
        while self.size > self.limit and self.items:
            self.size -= self.items.popitem(last=False)[1].nbytes


def _cut(
    times: NDArray[np.float64], frames: int, spacing: float, hop: float
) -> tuple[int, float, NDArray[np.int64]]:
    """Cut times into clips: stride (frames), period (s; 0 for evenly spaced clips), last rows."""
    if len(times) == 1:
        return 1, 0.0, np.zeros(1, np.int64)
    period = frame_period(times)
    if period <= 0:
        raise ConfigError("the times of a recording do not increase")
    stride = max(1, round(spacing / period))
    first = min((frames - 1) * stride, len(times) - 1)
    ends = np.arange(first, len(times), max(1, round(hop / period)))
    rows = held_clips(times, ends, frames, spacing, period)
    reaches, together = whole_clips(times, rows, spacing, period)
    if not reaches.any():  # shorter than a clip: the one clip repeats the first frame
        reaches[-1] = True
    kept = reaches & together
    ends, rows = ends[kept], rows[kept]
    # nearly all recordings are even: their rows follow from a stride, without a search by time
    is_even = np.array_equal(rows, _strided(ends[:, None], frames, stride))
    return stride, 0.0 if is_even else period, ends


def _strided(ends: Any, frames: int, stride: int) -> NDArray[np.int64]:
    """Rows of clips with a constant stride, int64 (..., T), oldest first."""
    rows: NDArray[np.int64] = np.maximum(ends - np.arange(frames - 1, -1, -1) * stride, 0)
    return rows.astype(np.int64)


def view_of(recording: Recording, row: int) -> int:
    """Index of the camera image of a frame."""
    assert recording.image is not None
    if recording.image_times is None:
        return row * len(recording.image) // len(recording.frames)
    return int(nearest(recording.image_times, recording.times[row : row + 1])[0])


def resize_frame(frame: NDArray[np.uint8], size: tuple[int, int]) -> NDArray[np.uint8]:
    """Resize an image, uint8 (H, W, 3), as training does.

    Example:
        >>> resize_frame(np.zeros((240, 320, 3), np.uint8), (64, 64)).shape
        (64, 64, 3)
    """
    if frame.shape[:2] == size:
        return np.ascontiguousarray(frame)
    shrinks = min(frame.shape[0] / size[0], frame.shape[1] / size[1]) >= 1
    much = max(frame.shape[0] / size[0], frame.shape[1] / size[1]) >= AVERAGED_FROM
    # INTER_AREA acts like nearest-neighbour interpolation on an enlarged axis (OpenCV's
    # InterpolationFlags), so both axes have to shrink
    how = cv2.INTER_AREA if shrinks and much else cv2.INTER_LINEAR
    out: NDArray[np.uint8] = cv2.resize(frame, size[::-1], interpolation=how)
    return out


def _tensor(array: NDArray[np.uint8]) -> torch.Tensor:
    """Tensor (..., 3, H, W) of an array (..., H, W, 3)."""
    return torch.from_numpy(np.moveaxis(array, -1, -3))


def collate(rows: Sequence[dict[str, Any]]) -> Batch:
    """Collate rows of `Clips`: stack tensors, turn numbers into tensors, list names.

    A tuple holds several rows of the batch, one for each touch of a sample.
    """
    batch: Batch = {}
    for key, first in rows[0].items():
        values = [row[key] for row in rows]
        if isinstance(first, tuple):
            values = [one for several in values for one in several]
            first = values[0] if values else ""
        if isinstance(first, torch.Tensor) and first.dtype == torch.uint8:
            # images keep the order they have in memory, channels last: no transposition here
            batch[key] = torch.stack([v.movedim(-3, -1) for v in values]).movedim(-1, -3)
        elif isinstance(first, torch.Tensor):
            batch[key] = torch.stack(values)
        elif isinstance(first, str):
            batch[key] = values
        elif isinstance(first, dict):
            batch[key] = {name: what for each in values for name, what in each.items()}
        else:
            batch[key] = torch.tensor(values)
    return batch
