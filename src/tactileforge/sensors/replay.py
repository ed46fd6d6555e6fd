"""A sensor that replays a file, so that everything live works without hardware."""

from __future__ import annotations

import re
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tactileforge.contracts import Frame, Frames
from tactileforge.data.frames import ImageFrames, VideoFrames
from tactileforge.errors import ConfigError, DataNotFoundError, TactileForgeError
from tactileforge.specs import spec

_IMAGES = {".bmp", ".jpeg", ".jpg", ".png", ".tif", ".tiff", ".webp"}


class Replay:
    """Replays a video, or a folder of images in the order of their numbers.

    In real time it behaves like a camera: a frame comes when it is due, and one that nobody read in
    time is lost. Otherwise all come, as fast as they are read, with the times they would have had.

    Args:
        path: A video file, or a folder of images.
        type: Type of sensor that made it; see `tactileforge.specs`.
        realtime: Whether to wait until a frame is due.
        loop: Whether to start again at the end.
        fps: Frames per second; None takes a video's own times, and for images the rate of the type.

    Attributes:
        spec: That of the type. Once open, height and width are those of the frames.

    Example:
        >>> with Replay("press.mp4", type="digit", realtime=False) as sensor:  # doctest: +SKIP
        ...     frame = sensor.read()
    """

    def __init__(
        self,
        path: str = "",
        *,
        type: str,
        realtime: bool = True,
        loop: bool = False,
        fps: float | None = None,
    ) -> None:
        self.path = path
        self.spec = spec(type)
        self.realtime = realtime
        self.loop = loop
        self.fps = fps
        self._frames: Frames | None = None
        self._times: NDArray[np.float64]
        self._start = 0.0
        self._next = 0

    def discover(self) -> list[str]:
        """The path, if it exists."""
        return [self.path] if self.path and Path(self.path).exists() else []

    def open(self) -> None:
        """Opens the file and starts the clock.

        Raises:
            ConfigError: No path is given.
            DataNotFoundError: There is nothing at the path.
            DataError: It is no video, or an image cannot be read.
        """
        frames = self._source()
        if isinstance(frames, VideoFrames) and self.fps is None:
            self._times = frames.times
        else:
            self._times = np.arange(len(frames)) / (self.fps or self.spec.fps)
        height, width = frames.shape
        self.spec = replace(self.spec, height=height, width=width)
        self._frames = frames
        self._next = 0
        self._start = time.monotonic()

    def _source(self) -> VideoFrames | ImageFrames:
        path = Path(self.path)
        if not self.path:
            raise ConfigError("the replay sensor has no path: set sensor.path=VIDEO or a folder")
        if not path.exists():
            raise DataNotFoundError(f"{path}: no such file or folder; correct sensor.path")
        if path.is_file():
            return VideoFrames(path)
        images = sorted(
            (file for file in path.iterdir() if file.suffix.lower() in _IMAGES), key=_by_number
        )
        if not images:
            raise DataNotFoundError(f"{path}: no image in this folder; correct sensor.path")
        return ImageFrames(images)

    def read(self, timeout: float = 1.0) -> Frame:
        """The next unseen frame.

        Raises:
            TactileForgeError: It is not open.
            TimeoutError: The next frame is due in more than ``timeout`` seconds.
            EOFError: The end is reached, and ``loop`` is off.
        """
        if self._frames is None:
            raise TactileForgeError(
                "the replay sensor is not open: use it in a with block, or call open()"
            )
        count = len(self._frames)
        if self.realtime:
            self._wait(timeout)
        if self._next >= count and not self.loop:
            raise EOFError(f"{self.path}: its {count} frames are over")
        index = self._next
        self._next += 1
        return Frame(array=self._frames.read([index % count])[0], time=self._due(index))

    def _due(self, index: int) -> float:
        """When a frame is due, in monotonic seconds; rounds follow each other one frame apart."""
        count = len(self._times)
        step = float(self._times[-1]) / (count - 1) if count > 1 else 1 / self.spec.fps
        rounds, place = divmod(index, count)
        return self._start + rounds * (float(self._times[-1]) + step) + float(self._times[place])

    def _wait(self, timeout: float) -> None:
        """Skips frames that are past, and waits for the next."""
        now = time.monotonic()
        last = None if self.loop else len(self._times) - 1
        while (last is None or self._next < last) and self._due(self._next + 1) <= now:
            self._next += 1
        wait = self._due(self._next) - now
        if wait > timeout:
            time.sleep(timeout)
            raise TimeoutError(f"{self.path}: no frame within {timeout} s")
        time.sleep(max(0.0, wait))

    def close(self) -> None:
        """Lets go of the file; a second call does nothing."""
        self._frames = None

    def __enter__(self) -> Replay:
        self.open()
        return self

    def __exit__(self, *error: object) -> None:
        self.close()


def _by_number(file: Path) -> list[tuple[bool, int, str]]:
    """Sorts ``2.png`` before ``10.png``."""
    parts = re.findall(r"\d+|\D+", file.name)
    return [(part.isdigit(), int(part) if part.isdigit() else 0, part) for part in parts]
