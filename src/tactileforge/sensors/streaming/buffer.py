"""Buffer of the newest clip of a sensor, cut by time; old frames never queue up."""

from __future__ import annotations

import threading
import warnings
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tactileforge.contracts import Frame
from tactileforge.data.frames.cut import clip_rows, frame_period, is_slow

#: Largest number of buffered frames, for any frame rate: a source with a stopped clock would fill
#: the memory.
_MOST = 512
#: Duration of frames kept beyond a clip, s, for an estimate of the frame rate.
_BEYOND = 0.5


@dataclass(frozen=True)
class FrameWithClip:
    """A frame and the clip ending with it, as one snapshot.

    Attributes:
        number: Number of the frame, counted from 1.
        frame: Frame of the sensor, unprepared.
        clip: Prepared clip, uint8 (T, h, w, 3); None before enough frames have arrived, or with a
            gap in them.
        period: Seconds between frames; 0 before the second.
    """

    number: int
    frame: Frame
    clip: NDArray[np.uint8] | None
    period: float


class ClipBuffer:
    """Keeps the frames of one clip. One thread writes, another reads the newest clip.

    Clips are cut as in training, see `data.frames.cut`.

    Args:
        frames: Number of frames of a clip, T.
        spacing: Seconds between the frames of a clip; 0 for one frame.
        prepare: Function from an image to the model's input.
    """

    def __init__(
        self,
        frames: int,
        spacing: float,
        prepare: Callable[[NDArray[np.uint8]], NDArray[np.uint8]],
    ) -> None:
        self.frames, self.spacing, self.prepare = frames, spacing, prepare
        self.count = 0
        self._items: deque[tuple[float, NDArray[np.uint8]]] = deque(maxlen=_MOST)
        self._newest: Frame | None = None
        self._lock = threading.Lock()

    def push(self, frame: Frame) -> None:
        """Adds a frame and drops frames too old for the next clip."""
        image = self.prepare(frame.array)  # here, once a frame, and not once for each clip with it
        horizon = frame.time - (self.frames - 1) * self.spacing - _BEYOND
        with self._lock:
            self.count += 1
            self._newest = frame
            self._items.append((frame.time, image))
            # one frame more than a clip stays whatever its age: the period is measured on them
            while len(self._items) > self.frames + 1 and self._items[0][0] < horizon:
                self._items.popleft()

    def newest(self) -> FrameWithClip | None:
        """The newest frame and its clip; None before the first."""
        with self._lock:
            # copied under the lock, cut outside of it: the thread of the sensor must not wait for
            # a cut
            frame, number, items = self._newest, self.count, list(self._items)
        if frame is None:
            return None
        times = np.array([time for time, _ in items])
        period = frame_period(times) if len(times) > 1 else 0.0
        rows = clip_rows(times, self.frames, self.spacing, period)
        clip = None if rows is None else np.stack([items[row][1] for row in rows])
        return FrameWithClip(number, frame, clip, period)


def warn_of_slow_frames(period: float, spacing: float, frames: int, stacklevel: int = 3) -> None:
    """Warns of a frame rate too low for the clips of a model.

    Args:
        period: Seconds between arriving frames.
        spacing: Seconds between the frames of a clip in training.
        frames: Number of frames of a clip.
        stacklevel: Level of the warning in the call stack, see `warnings.warn`.
    """
    if is_slow(period, spacing, frames):
        warnings.warn(
            f"frames come every {period:.3g} s, and the model was trained on frames {spacing:.3g} "
            f"s apart: clips are {period / spacing:.1f} times as long. Record at "
            f"{1 / spacing:.3g} frames a second or more, or measure the model on such clips",
            stacklevel=stacklevel,
        )
