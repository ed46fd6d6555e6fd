"""Queues of a running take: frames, encoded on arrival, and samples of other devices."""

from __future__ import annotations

import math
import threading
from collections import deque
from collections.abc import Callable, Sequence
from concurrent.futures import Executor, Future
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from tactileforge_markers.track import MarkerTracker

from tactileforge.contracts import Frame
from tactileforge.data import encode_image


@dataclass(frozen=True)
class PendingFrame:
    """A frame with pending encoding.

    Attributes:
        time: Monotonic time, s.
        encoded: Encoded image, by codec.
        raw: Raw values of the frame, see `contracts.Frame`; None for an image.
        depth: Height map, int16 (h, w), micrometres into the gel; None if it is not measured.
        markers: Displacement of markers, float32 (N, 2), pixels; None if they are not followed.
    """

    time: float
    encoded: Future[dict[str, bytes]]
    raw: NDArray[np.float32] | None
    depth: Future[NDArray[np.int16]] | None = None
    markers: Future[NDArray[np.float32]] | None = None


class FrameQueue:
    """Queue of frames of one sensor, encoded in a pool and kept until they are cut and written.

    Adding a frame never blocks: if the queue is full, the frame is dropped and counted.

    Args:
        pool: Executor for encoding.
        codecs: Names of codecs, of `data.shards.shards.CODECS`.
        quality: Quality of JPEG.
        queue: Largest number of frames waiting for encoding.
        hold: Largest number of frames waiting to be written.

    Attributes:
        waiting: Number of frames waiting for encoding.
        dropped: Number of frames dropped since `start`.
        measure: Function from an image to its height map; None for no height maps.
        tracker: Tracker of the gel's markers; None for no markers.
        in_order: Executor of one thread for the tracker, which needs frames in their order.
    """

    def __init__(
        self, pool: Executor, codecs: Sequence[str], quality: int, queue: int, hold: int
    ) -> None:
        self.pool, self.codecs, self.quality = pool, tuple(codecs), quality
        self.queue, self.hold = queue, hold
        self.waiting = self.dropped = 0
        self.measure: Callable[[NDArray[np.uint8]], NDArray[np.int16]] | None = None
        self.tracker: MarkerTracker | None = None
        self.in_order: Executor | None = None
        self._shots: deque[PendingFrame] = deque()
        self._lock = threading.Lock()
        self._from = self._end = math.inf

    def start(self, time: float, end: float) -> None:
        """Starts keeping frames from ``time`` to before ``end``, monotonic s."""
        self._shots.clear()
        self.dropped = 0
        self._from, self._end = time, end

    def stop(self) -> None:
        """Stops keeping frames."""
        self._from = math.inf

    def take(self, frame: Frame) -> None:
        """Queues a frame; called in the sensor's thread."""
        if not self._from <= frame.time < self._end:
            return
        if self.waiting >= self.queue or len(self._shots) >= self.hold:
            self.dropped += 1
            return
        with self._lock:  # the threads of the pool count down meanwhile
            self.waiting += 1
        future = self.pool.submit(self.encode, frame.array)
        future.add_done_callback(self._encoded)
        depth = self.pool.submit(self.measure, frame.array) if self.measure else None
        markers = None
        if self.tracker is not None and self.in_order is not None:
            markers = self.in_order.submit(self.tracker.read, frame.array)
        self._shots.append(PendingFrame(frame.time, future, frame.raw, depth, markers))

    def encode(self, picture: NDArray[np.uint8]) -> dict[str, bytes]:
        """Encodes an image with every codec."""
        return {
            codec: encode_image(picture, codec, self.quality if codec == "jpg" else None)
            for codec in self.codecs
        }

    def _encoded(self, future: Future[dict[str, bytes]]) -> None:
        with self._lock:
            self.waiting -= 1

    def cut(self, until: float) -> list[PendingFrame]:
        """Removes and returns the frames before a time; their encoding may still be pending."""
        frames = []
        while self._shots and self._shots[0].time < until:
            frames.append(self._shots.popleft())
        return frames


class SampleBuffer:
    """Buffer of the samples of a wrench sensor or robot, kept until they are cut and written.

    Args:
        hold: Largest number of kept samples; more are dropped and counted.
        width: Number of values of a sample.

    Attributes:
        dropped: Number of samples dropped since `start`.
    """

    def __init__(self, hold: int, width: int = 6) -> None:
        self.hold = hold
        self.dropped = 0
        # allocated once: converting thousands of samples later would hold the GIL and block threads
        self._times = np.empty(hold, np.float64)
        self._values = np.empty((hold, width), np.float32)
        self._count = 0
        self._lock = threading.Lock()
        self._from = math.inf

    def start(self, time: float, end: float) -> None:
        """Starts keeping samples from ``time``, also after ``end`` for interpolation."""
        with self._lock:
            self._count = self.dropped = 0
            self._from = time

    def stop(self) -> None:
        """Stops keeping samples."""
        self._from = math.inf

    def take(self, frame: Frame) -> None:
        """Adds a sample; called in the sensor's thread."""
        if frame.time < self._from or frame.raw is None:
            return
        with self._lock:
            if self._count == self.hold:
                self.dropped += 1
                return
            self._times[self._count] = frame.time
            self._values[self._count] = frame.raw
            self._count += 1

    def all(self) -> tuple[NDArray[np.float64], NDArray[np.float32]]:
        """Times (N,) and values (N, width) of the kept samples."""
        with self._lock:
            return self._times[: self._count].copy(), self._values[: self._count].copy()

    def cut(self, until: float) -> tuple[NDArray[np.float64], NDArray[np.float32]]:
        """Removes and returns the samples before a time."""
        with self._lock:
            end = self._count
            count = int(np.searchsorted(self._times[:end], until))
            samples = self._times[:count].copy(), self._values[:count].copy()
            self._times[: end - count] = self._times[count:end]
            self._values[: end - count] = self._values[count:end]
            self._count = end - count
        return samples
