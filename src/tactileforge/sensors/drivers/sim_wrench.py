"""A simulated wrench sensor, for recording forces without hardware."""

from __future__ import annotations

import math
import time
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from tactileforge.contracts import Frame, Sensor
from tactileforge.errors import ConfigError, TactileForgeError
from tactileforge.sensors.drivers.force_torque import ForceTorque
from tactileforge.sensors.drivers.packet_sensor import NO_PICTURE


class SimWrench(Sensor):
    """One press per ``period``: normal force ``newton`` (1 - cos) / 2, and shear of a fifth.

    It runs in real time. Samples that nobody has read yet come late and are not lost, as they wait
    in the buffer of a serial port.

    Args:
        fps: Samples a second.
        newton: Largest normal force, N.
        period: Seconds from press to press.
        bias: What it shows without load, N on every axis.
        rest: Seconds without load after it is opened, for its tare.

    Attributes:
        spec: Kind ``wrench``, at that rate.
        start: Monotonic seconds at which it was opened.
    """

    spec = replace(ForceTorque.spec, name="sim_wrench")

    def __init__(
        self,
        fps: float = 100.0,
        newton: float = 5.0,
        period: float = 2.0,
        bias: float = 0.0,
        rest: float = 4.0,
    ) -> None:
        if not fps > 0 or not period > 0:
            raise ConfigError(f"fps={fps} and period={period}: give values above 0")
        self.newton, self.period, self.bias, self.rest = newton, period, bias, rest
        self.spec = replace(self.spec, fps=fps)
        self.start: float | None = None
        self._next = 0

    def discover(self) -> list[str]:
        """Its only address: a simulated sensor is always attached."""
        return ["sim_wrench"]

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
            raise TactileForgeError("the sim_wrench is not open: use it in a with block")
        due = self.start + self._next / self.spec.fps
        wait = due - time.monotonic()
        if wait > timeout:
            time.sleep(timeout)
            raise TimeoutError(f"sim_wrench: no sample within {timeout} s")
        time.sleep(max(0.0, wait))
        self._next += 1
        return Frame(array=NO_PICTURE, time=due, raw=self.wrench(due - self.start))

    def wrench(self, seconds: float) -> NDArray[np.float32]:
        """The wrench at a time in seconds after opening, float32 (6,), N and N m."""
        phase = 2 * math.pi * max(0.0, seconds - self.rest) / self.period
        normal = self.newton * (1 - math.cos(phase)) / 2
        shear = 0.2 * normal
        forces = np.array([shear, 0.0, normal]) + self.bias
        return np.array([*forces, 0.0, 0.01 * shear, 0.0], np.float32)

    def close(self) -> None:
        """Stops; a second call does nothing."""
        self.start = None
