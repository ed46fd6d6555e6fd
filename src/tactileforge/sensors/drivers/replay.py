"""Replay of a file as a sensor, for live use without hardware."""

from __future__ import annotations

import re
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tactileforge.contracts import Frame, Frames, Sensor, SensorSpec
from tactileforge.data.frames.companions import without_companions
from tactileforge.data.frames.lazy import ImageFrames, VideoFrames
from tactileforge.data.frames.picture_files import IMAGE_SUFFIXES
from tactileforge.data.frames.video_clock import video_times
from tactileforge.data.shards import shards
from tactileforge.errors import ConfigError, DataNotFoundError, TactileForgeError, unknown
from tactileforge.sensors.frame_contract import check_orientation
from tactileforge.specs.published import spec


class Replay(Sensor):
    """Replay of a video, a folder of numbered images, or a recording of a shard.

    In real time it behaves like a camera: a frame comes when it is due, and a frame not read in
    time is lost. Otherwise all come, as fast as they are read, with their due times.

    Args:
        path: Path of a video file, a folder of images, or a shard (``.tar``).
        type: Type of the recorded sensor, see `specs.published`; not needed for a shard.
        key: Key of the recording in a shard; "" for the first.
        realtime: Whether to wait for the due time of a frame.
        loop: Whether to start again at the end.
        fps: Frames per second; None takes the times of the video or recording, and for images the
            rate of the type.

    Attributes:
        spec: Spec of the type, always of kind ``image``; once open, with height and width of the
            frames.

    Example:
        >>> with Replay("press.mp4", type="digit", realtime=False) as sensor:  # doctest: +SKIP
        ...     frame = sensor.read()
    """

    #: Spec of a shard before it is open.
    spec = SensorSpec(
        name="replay", height=0, width=0, fps=30.0, area_mm=None, force_scale=(1.0, 1.0, 1.0)
    )

    def __init__(
        self,
        path: str = "",
        *,
        type: str = "",
        key: str = "",
        realtime: bool = True,
        loop: bool = False,
        fps: float | None = None,
    ) -> None:
        self.path, self.type, self.key = path, type, key
        if type:
            self.spec = replace(spec(type), kind="image")
        self.realtime = realtime
        self.loop = loop
        self.fps = fps
        self._frames: Frames | None = None
        self._times: NDArray[np.float64]
        self._start = 0.0
        self._next = 0

    def discover(self) -> list[str]:
        """Path of the file, if it exists."""
        return [self.path] if self.path and Path(self.path).exists() else []

    def open(self) -> None:
        """Open the file and start the clock.

        Raises:
            ConfigError: No path or type is given, or the shard has no such recording.
            DataNotFoundError: There is nothing at the path.
            DataError: The file is not a video, or an image cannot be read.
            SensorError: The frames lie on their side.
        """
        frames, times = self._source()
        if times is None or self.fps is not None:
            times = np.arange(len(frames)) / (self.fps or self.spec.fps)
        self._times = times - times[0]
        height, width = frames.shape
        self.spec = replace(self.spec, height=height, width=width)
        check_orientation(self.spec)
        self._frames = frames
        self._next = 0
        self._start = time.monotonic()

    def _source(self) -> tuple[Frames, NDArray[np.float64] | None]:
        """Frames of the file, and their times if there are any."""
        path = Path(self.path)
        if not self.path:
            raise ConfigError(
                "the replay sensor has no path: set sensor.replay.path= to a video, a folder of "
                "images or a shard"
            )
        if not path.exists():
            raise DataNotFoundError(f"{path}: no such file or folder; correct sensor.replay.path")
        if path.suffix == ".tar":
            keys = []
            for recording in shards.read_shard(path):
                if self.key in ("", recording.key):
                    known = spec(self.type or recording.sensor)
                    self.spec = replace(known, kind="image")
                    return recording.frames, recording.times
                keys.append(recording.key)
            raise ConfigError(unknown(f"recording of {path}", self.key, keys))
        if not self.type:
            raise ConfigError(f"{path}: set sensor.replay.type= to the sensor that made it")
        if path.is_file():
            video = VideoFrames(path)
            return video, None if self.fps else video_times(video, "set sensor.replay.fps=")
        files = (file for file in path.iterdir() if file.suffix.lower() in IMAGE_SUFFIXES)
        images = sorted(without_companions([*files], path), key=_by_number)
        if not images:
            raise DataNotFoundError(f"{path}: no image in this folder; correct sensor.replay.path")
        return ImageFrames(images), None

    def read(self, timeout: float = 1.0) -> Frame:
        """Read the next unseen frame.

        Raises:
            TactileForgeError: The sensor is not open.
            TimeoutError: The next frame is due in more than ``timeout`` seconds.
            EOFError: The end is reached without ``loop``.
        """
        if self._frames is None:
            raise TactileForgeError(
                "the replay sensor is not open: use it in a with block, or call open()"
            )
        count = len(self._frames)
        if self.realtime:
            # late frames are left out, but the last one of a file is shown however late
            now = time.monotonic()
            last = None if self.loop else len(self._times) - 1
            while (last is None or self._next < last) and self._due(self._next + 1) <= now:
                self._next += 1
            wait = self._due(self._next) - now
            if wait > timeout:
                time.sleep(timeout)
                raise TimeoutError(f"{self.path}: no frame within {timeout} s")
            time.sleep(max(0.0, wait))
        if self._next >= count and not self.loop:
            raise EOFError(f"{self.path}: its {count} frames are over")
        index = self._next
        self._next += 1
        return Frame(array=self._frames.read([index % count])[0], time=self._due(index))

    def _due(self, index: int) -> float:
        """Due time of a frame, monotonic seconds; repetitions are one frame period apart."""
        count = len(self._times)
        step = float(self._times[-1]) / (count - 1) if count > 1 else 1 / self.spec.fps
        rounds, place = divmod(index, count)
        return self._start + rounds * (float(self._times[-1]) + step) + float(self._times[place])

    def close(self) -> None:
        """Close the file; a second call does nothing."""
        self._frames = None


def _by_number(file: Path) -> list[tuple[bool, int, str]]:
    """Sort key of file names by their numbers: ``2.png`` before ``10.png``."""
    parts = re.findall(r"\d+|\D+", file.name)
    return [(part.isdigit(), int(part) if part.isdigit() else 0, part) for part in parts]
