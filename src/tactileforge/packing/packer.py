"""Packer: decodes, filters and encodes one recording."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import Any, TypeAlias, cast

import cv2
import numpy as np
from numpy.typing import NDArray

from tactileforge.contracts import Frames, Recording
from tactileforge.data.shards import shards
from tactileforge.errors import DataError
from tactileforge.packing import filters
from tactileforge.packing.options import PackOptions
from tactileforge.plugins import registry

#: Frames to decode at once: memory of a process does not grow with the length of a recording.
_CHUNK = 16
#: Tolerated unreadable frames of a recording; with more, all of it counts as unreadable.
_MAX_FRAMES = 8

#: Function from frame numbers to frames: arrays (n, H, W, 3), or encoded images.
Fetch: TypeAlias = Callable[[Sequence[int]], Sequence[Any] | NDArray[np.uint8]]


class Packer:
    """Packer of one recording.

    Args:
        recording: Recording with lazy frames.
        options: Filter, size and codec.

    Attributes:
        read: Number of frames read.
        bad: Line for each unreadable frame.
        unmarked: Reason for a recording without marker tracks; "" with them, or if not asked for.
    """

    def __init__(self, recording: Recording, options: PackOptions) -> None:
        self.recording = recording
        self.options = options
        self.read = 0
        self.bad: list[str] = []
        self.unmarked = ""
        self._markers: Any = None  # a tracker of recordings, of a package

    def pack(self, tick: Callable[[int], None]) -> tuple[Recording, shards.Packed] | None:
        """Filtered recording and its encoded images; None if the filter leaves nothing."""
        whole = self.recording
        if whole.sensor in self.options.markers:
            try:
                self._markers = registry.load("trackers", "markers")(whole)
            except DataError as error:
                self.unmarked = f"{error} (packed without markers)"
        rows, frames = self._frames(tick)
        if not rows:
            return None
        recording = whole
        if len(rows) < len(whole.frames):
            seen, count = whole.image_times, len(whole.frames)
            if whole.image is not None and seen is None and len(whole.image) > 1:
                # views without times are spread evenly, each in the middle of its frames; once
                # frames are left out, only times tell which view is of which frame
                middle = (np.arange(len(whole.image)) + 0.5) * count / len(whole.image) - 0.5
                seen = np.interp(middle, np.arange(count), whole.times)
            recording = replace(whole.select(rows), image_times=seen)
        if self._markers is not None:
            recording = cast(Recording, self._markers.added(recording, rows))
        surface = recording.surface
        packed = shards.Packed(
            shards.describe_recording(recording),
            self.options.codec,
            frames,
            self._all(whole.no_contact),
            self._all(whole.image),
            # lossless, and never resized: their levels are displacements
            []
            if surface is None
            else [shards.encode_image(one, "png") for one in surface.read(range(len(surface)))],
        )
        return recording, packed

    def _frames(self, tick: Callable[[int], None]) -> tuple[list[int], list[bytes]]:
        """Numbers of the frames left by the filter, and the encoded frames."""
        options, whole = self.options, self.recording
        sampled = filters.sample_in_time(whole.times, options.filter.every).tolist()
        threshold = options.filter.threshold(whole.sensor)
        # without a threshold nothing looks at the pixels, so encoded frames can be copied; a still
        # has no predecessor to compare with
        if threshold is None or len(sampled) == 1:
            shown = self._followed(self._read(self._fetch(whole.frames), sampled, tick))
        else:
            shown = self._followed(self._read(whole.frames.read, sampled, tick))
            span = filters.reach(whole.times[sampled], options.filter.span)
            shown = filters.select_lively(shown, whole.times, threshold, span)
        rows, encoded = [], []
        for row, frame in shown:
            rows.append(row)
            encoded.append(self._encoded(frame))
        return rows, encoded

    def _followed(self, shown: Iterator[tuple[int, Any]]) -> Iterator[tuple[int, Any]]:
        return shown if self._markers is None else self._markers.follow(shown)

    def _read(
        self, fetch: Fetch, rows: Sequence[int], tick: Callable[[int], None]
    ) -> Iterator[tuple[int, Any]]:
        """Read frames with their numbers, a chunk at a time; skips a few unreadable ones."""
        for start in range(0, len(rows), _CHUNK):
            chunk = rows[start : start + _CHUNK]
            try:
                frames = fetch(chunk)
            except DataError:  # one by one, to lose the damaged frames alone
                for row in chunk:
                    yield from self._one(fetch, row)
            else:
                self.read += len(chunk)
                yield from zip(chunk, frames, strict=True)
            tick(chunk[-1])

    def _one(self, fetch: Fetch, row: int) -> Iterator[tuple[int, Any]]:
        try:
            frames = fetch([row])
        except DataError as error:
            if len(self.bad) == _MAX_FRAMES:
                raise
            self.bad.append(f"{self.recording.key}, frame {row}: {error}")
            return
        self.read += 1
        yield row, frames[0]

    def _all(self, frames: Frames | None) -> list[bytes]:
        """Encode all images of a group."""
        if frames is None:
            return []
        fetch = self._fetch(frames)
        rows = range(len(frames))
        chunks = (rows[start : start + _CHUNK] for start in rows[::_CHUNK])
        return [self._encoded(picture) for chunk in chunks for picture in fetch(chunk)]

    def _fetch(self, frames: Frames) -> Fetch:
        """Function to read frames: decoded, or encoded if those of a shard fit the options."""
        is_same = isinstance(frames, shards.PackedFrames) and frames.codec == self.options.codec
        if not is_same or self.options.quality or _smaller(frames.shape, self.options.size):
            return frames.read
        packed = cast(shards.PackedFrames, frames)
        return lambda rows: [packed.encoded(row) for row in rows]

    def _encoded(self, frame: NDArray[np.uint8] | bytes) -> bytes:
        if isinstance(frame, bytes):
            return frame
        size = _smaller(frame.shape[:2], self.options.size)
        shown: NDArray[np.uint8] = frame
        if size:
            shown = cv2.resize(frame, size[::-1], interpolation=cv2.INTER_AREA)
        return shards.encode_image(shown, self.options.codec, self.options.quality)


def _smaller(shape: Sequence[int], size: int | None) -> tuple[int, int] | None:
    """Height and width after shrinking; None for an unchanged size."""
    shorter = min(shape)
    if size is None or shorter <= size:
        return None
    return round(shape[0] * size / shorter), round(shape[1] * size / shorter)
