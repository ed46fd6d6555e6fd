"""Simulated tactile sensor in continual contact, for live use without hardware."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import replace
from itertools import chain, count, cycle, islice
from math import ceil
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from numpy.typing import NDArray

from tactileforge.contracts import Frame, Sensor
from tactileforge.errors import TactileForgeError
from tactileforge.specs import spec

#: A picture and its force.
_Shown: TypeAlias = tuple[NDArray[np.uint8], NDArray[np.float32]]

if TYPE_CHECKING:
    from tactileforge_sim.config import SimConfig

#: Largest lag of the frames behind the clock before frames are left out, s.
_LATE = 0.1


class SimSensor(Sensor):
    """An endless sequence of simulated touches from a seed.

    In real time a frame comes when it is due. If it is not read in time, or the machine is too
    slow, none comes meanwhile, and the touch goes on later. Otherwise frames come as fast as they
    are simulated, with their due times.

    Args:
        type: Type of the sensor, one of `specs.published.SIMULATED`.
        indenters: Touching objects: ``pretrain``, ``bench``, ``textures``, ``all``, or the name of
            a shape.
        motions: Motions: ``atomic``, ``force_trial``, ``manipulation``, ``all``, or one motion.
        size: Shorter side of a frame, pixels.
        realtime: Whether to wait for the due time of a frame.
        seed: Seed of the touches.
        rest: Seconds without contact after opening, for a background.

    Attributes:
        spec: Spec of the type, with height, width and rate of the frames.
        force: float32 (3,), force of the object on the gel in the last frame read, N; x and y of
            the picture, z into the gel.

    Example:
        >>> with SimSensor("digit", realtime=False, size=32) as sensor:
        ...     sensor.read().array.shape
        (43, 32, 3)
    """

    def __init__(
        self,
        type: str = "gelsight_mini",
        indenters: str = "all",
        motions: str = "manipulation",
        size: int = 240,
        realtime: bool = True,
        seed: int = 0,
        rest: float = 0.0,
    ) -> None:
        known = spec(type)
        scale = size / min(known.height, known.width)
        self.spec = replace(
            known, height=round(known.height * scale), width=round(known.width * scale)
        )
        self.indenters, self.motions = indenters, motions
        self.size, self.seed, self.realtime, self.rest = size, seed, realtime, rest
        self.force: NDArray[np.float32] = np.zeros(3, np.float32)
        self._frames: Iterator[_Shown] | None = None
        self._fps, self._start, self._next = known.fps, 0.0, 0

    def discover(self) -> list[str]:
        """Address of the sensor; a simulated one is always attached."""
        return [f"sim:{self.spec.name}"]

    def open(self) -> None:
        """Start the first touch and the clock.

        Raises:
            ConfigError: Unknown sensor, indenter or motion.
        """
        from tactileforge_sim.config import SimConfig
        from tactileforge_sim.scene import simulated_rate

        config = SimConfig(
            sensors=(self.spec.name,),
            indenters=self.indenters,
            motions=self.motions,
            size=self.size,
            seconds=0.8,
            force=(1.0, 8.0),
            markers=None,
            viscosity=0.0,
            lag=0.0,
            seed=self.seed,
        )
        self._fps = simulated_rate(self.spec.name)
        self.spec = replace(self.spec, fps=self._fps)
        frames = _rested(_frames(config), round(self.rest * self._fps))
        # the first frame is simulated before the clock starts, as it takes long
        self._frames = chain([next(frames)], frames)
        self._next = 0
        self._start = time.monotonic()

    def read(self, timeout: float = 1.0) -> Frame:
        """Read the next unseen frame.

        Raises:
            TactileForgeError: The sensor is not open.
            TimeoutError: The next frame is due in more than ``timeout`` seconds.
        """
        if self._frames is None:
            raise TactileForgeError(
                "the sim sensor is not open: use it in a with block, or call open()"
            )
        if self.realtime:
            wait = self._start + self._next / self._fps - time.monotonic()
            if wait < -_LATE:  # the frames meanwhile are lost, as those of a camera
                self._next += ceil(-wait * self._fps)
                wait = self._start + self._next / self._fps - time.monotonic()
            if wait > timeout:
                time.sleep(timeout)
                raise TimeoutError(f"sim: no frame within {timeout} s")
            time.sleep(max(0.0, wait))
        array, self.force = next(self._frames)
        if self.realtime:  # a new touch may take long to simulate: its first frame is due now
            late = time.monotonic() - self._start - self._next / self._fps
            self._next += max(0, int((late - _LATE) * self._fps))
        due = self._start + self._next / self._fps
        self._next += 1
        return Frame(array=array, time=due)

    def close(self) -> None:
        """End the touch; a second call does nothing."""
        self._frames = None


def _rested(frames: Iterator[_Shown], number: int) -> Iterator[_Shown]:
    """Prepend frames without contact."""
    clear: list[_Shown] = []
    for shown in frames:
        clear.append(shown)
        if shown[1].any():
            break
    # the frames before the first contact, again and again; each has noise of its own
    yield from islice(cycle(clear[:-1] or clear), number)
    yield from clear
    yield from frames


def _frames(config: SimConfig) -> Iterator[_Shown]:
    """Yield frames and forces of one touch after the other, on one unit of the sensor."""
    from tactileforge_sim.play import play_scenes

    for number in count():
        scene = replace(config.scene(number), unit=config.seed)
        for shots in play_scenes(scene, config.sensors, config.size, markers=config.markers):
            yield from zip(shots.pictures, shots.force, strict=True)
