"""A simulated robot, for recording demonstrations without hardware."""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from tactileforge.contracts import Frame, Sensor
from tactileforge.errors import ConfigError, TactileForgeError
from tactileforge.sensors.drivers.packet_sensor import NO_PICTURE
from tactileforge.sensors.drivers.serial_robot import SerialRobot


class SimRobot(Sensor):
    """Joints that swing; each is commanded where it will be a sample later.

    It runs in real time. Joint i is at ``sin(2 pi t / period + i)``.

    Args:
        joints: How many; as many states as actions.
        fps: Samples a second.
        period: Seconds of a swing.

    Attributes:
        spec: Kind ``robot``.
        start: Monotonic seconds at which it was opened; None while it is closed.
    """

    spec = replace(SerialRobot.spec, name="sim_robot", states=4, actions=4)

    def __init__(self, joints: int = 4, fps: float = 50.0, period: float = 2.0) -> None:
        if joints < 1 or not fps > 0 or not period > 0:
            raise ConfigError(f"joints={joints}, fps={fps}, period={period}: give values above 0")
        self.joints, self.period = joints, period
        self.spec = replace(self.spec, fps=fps, states=joints, actions=joints)
        self.start: float | None = None
        self._next = 0

    def discover(self) -> list[str]:
        """Its only address: a simulated robot is always attached."""
        return ["sim_robot"]

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
            raise TactileForgeError("the sim_robot is not open: use it in a with block")
        due = self.start + self._next / self.spec.fps
        wait = due - time.monotonic()
        if wait > timeout:
            time.sleep(timeout)
            raise TimeoutError(f"sim_robot: no sample within {timeout} s")
        time.sleep(max(0.0, wait))
        self._next += 1
        now = due - self.start
        raw = np.concatenate([self.state(now), self.state(now + 1 / self.spec.fps)])
        return Frame(array=NO_PICTURE, time=due, raw=raw)

    def state(self, seconds: float) -> NDArray[np.float32]:
        """The joints at a time in seconds after opening, float32 (joints,)."""
        phase = 2 * np.pi * seconds / self.period + np.arange(self.joints)
        state: NDArray[np.float32] = np.sin(phase).astype(np.float32)
        return state

    def close(self) -> None:
        """Stops; a second call does nothing."""
        self.start = None
