"""Base of simulated sensors without images: samples at a rate, in real time."""

from __future__ import annotations

import time
from abc import abstractmethod

import numpy as np
from numpy.typing import NDArray

from tactileforge.contracts import Frame, Sensor
from tactileforge.errors import TactileForgeError
from tactileforge.sensors import NO_PICTURE


class SimSamples(Sensor):
    """Base of sensors with samples at the rate of the spec, computed by a subclass.

    Unread samples come late and are not lost, as with the buffer of a serial port.

    Attributes:
        start: Time of opening, monotonic seconds; None while closed.
    """

    def __init__(self) -> None:
        self.start: float | None = None
        self._next = 0

    def discover(self) -> list[str]:
        """Address of the sensor; a simulated one is always attached."""
        return [self.spec.name]

    def open(self) -> None:
        """Start the clock."""
        self.start, self._next = time.monotonic(), 0

    def read(self, timeout: float = 1.0) -> Frame:
        """Read the next sample.

        Raises:
            TactileForgeError: The sensor is not open.
            TimeoutError: The sample is due in more than ``timeout`` seconds.
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
        """Values at a time after opening, s; see `contracts.Frame.raw`."""

    def close(self) -> None:
        """Stop; a second call does nothing."""
        self.start = None
