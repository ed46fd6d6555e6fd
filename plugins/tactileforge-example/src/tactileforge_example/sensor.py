"""A synthetic sensor: a ball is pressed into its gel and lifted off, again and again."""

from __future__ import annotations

import math
import time

import numpy as np
from numpy.typing import NDArray

from tactileforge.contracts import Frame, SensorSpec
from tactileforge.errors import TactileForgeError
from tactileforge_example.synthetic import GEL, press


class Dummy:
    """A device without hardware. It runs in real time: unread frames are lost.

    Args:
        gain: Contrast of the contact in the image.
        rest: Time without contact after opening and between two presses of a second, s; recorders
            take the background of each take then.
    """

    #: An attribute of the class: data sets and encoders look up the type of sensor by name.
    spec = SensorSpec(
        name="dummy",
        height=120,
        width=160,
        fps=30.0,
        area_mm=(12.0, 16.0),
        force_scale=(1.0, 1.0, 5.0),
    )

    def __init__(self, gain: float = 1.0, rest: float = 2.0) -> None:
        self.gain, self.rest = gain, rest
        self._start: float | None = None
        self._next = 0

    def discover(self) -> list[str]:
        """Lists no device, as none is ever attached."""
        return []

    def open(self) -> None:
        """Starts the clock. A driver imports its vendor's software and claims the device here."""
        self._start = time.monotonic()
        self._next = 0

    def read(self, timeout: float = 1.0) -> Frame:
        """Waits for the next unseen frame.

        Raises:
            TactileForgeError: It is not open.
            TimeoutError: The next frame is more than ``timeout`` seconds away.
        """
        if self._start is None:
            raise TactileForgeError(
                "the sensor is not open: use it in a with block, or call open()"
            )
        now = time.monotonic()
        index = max(self._next, int((now - self._start) * self.spec.fps))
        due = self._start + index / self.spec.fps
        if due - now > timeout:
            time.sleep(timeout)
            raise TimeoutError(f"no frame within {timeout} s")
        time.sleep(max(0.0, due - now))
        self._next = index + 1
        return Frame(array=self._noisy(self._draw(index / self.spec.fps), index), time=due)

    def _noisy(self, image: NDArray[np.uint8], index: int) -> NDArray[np.uint8]:
        """Adds the noise of a camera: recorders take a bit-identical picture for a frozen one."""
        noise = np.random.default_rng(index).integers(-1, 2, image.shape)
        return (image + noise).clip(0, 255).astype(np.uint8)

    def _draw(self, seconds: float) -> NDArray[np.uint8]:
        pressed = max(0.0, seconds % (self.rest + 1.0) - self.rest)  # s since the ball touched
        depth = 0.5 * math.sin(math.pi * pressed)
        image = press(depth, self.spec.height, self.spec.width)
        gel = np.asarray(GEL)
        amplified: NDArray[np.float64] = (gel + self.gain * (image - gel)).clip(0, 255)
        return amplified.astype(np.uint8)

    def close(self) -> None:
        """Stops; a second call does nothing."""
        self._start = None

    def __enter__(self) -> Dummy:
        self.open()
        return self

    def __exit__(self, *error: object) -> None:
        self.close()
