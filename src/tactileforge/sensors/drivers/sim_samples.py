"""Base of simulated sensors without images: samples at a rate, in real time."""

from __future__ import annotations

import time
from abc import abstractmethod

import numpy as np
from numpy.typing import NDArray

from tactileforge.contracts import Frame, Sensor
from tactileforge.errors import TactileForgeError
from tactileforge.sensors.drivers.packet_sensor import NO_PICTURE


class SimSamples(Sensor):
    """Samples that fall due at the rate of the spec; a subclass says what they carry.

    Samples that nobody has read yet come late and are not lost, as they wait in the buffer of a
    serial port.

    Attributes:
        start: Monotonic seconds at which it was opened; None while it is closed.
    """

    def __init__(self) -> None:
        self.start: float | None = None
        self._next = 0

    def discover(self) -> list[str]:
        """Its only address: a simulated sensor is always attached."""
        return [self.spec.name]

    def open(self) -> None:
        """Starts the clock."""
        self.start, self._next = time.monotonic(), 0

    def read(self, timeout: float = 1.0) -> Frame:
        """The next sample.

        Raises:
            TactileForgeError: It is not open.
            TimeoutError: It is due in more than ``timeout`` seconds.
        """
        if self.start is None:
            raise TactileForgeError(f"the {self.spec.name} is not open: use it in a with block")
        due = self.start + self._next / self.spec.fps
        wait = due - time.monotonic()
        if wait > timeout:
            time.sleep(timeout)
            raise TimeoutError(f"{self.spec.name}: no sample within {timeout} s")
        time.sleep(max(0.0, wait))
        self._next += 1
        return Frame(array=NO_PICTURE, time=due, raw=self.sample(due - self.start))

    @abstractmethod
    def sample(self, seconds: float) -> NDArray[np.float32]:
        """The values at a time in seconds after opening; see `contracts.Frame.raw`."""

    def close(self) -> None:
        """Stops; a second call does nothing."""
        self.start = None
