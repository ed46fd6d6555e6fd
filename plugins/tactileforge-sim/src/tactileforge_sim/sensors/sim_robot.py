"""Simulated robot, for recording demonstrations without hardware."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from tactileforge.errors import ConfigError
from tactileforge.sensors import SerialRobot
from tactileforge_sim.sensors.sim_samples import SimSamples


class SimRobot(SimSamples):
    """Swinging joints; the command of each is its state one sample later.

    It runs in real time. Joint i is at ``sin(2 pi t / period + i)``.

    Args:
        joints: Number of joints, states and actions.
        fps: Samples a second.
        period: Seconds of a swing.

    Attributes:
        spec: Spec of kind ``robot``.
    """

    spec = replace(SerialRobot.spec, name="sim_robot", states=4, actions=4)

    def __init__(self, joints: int = 4, fps: float = 50.0, period: float = 2.0) -> None:
        super().__init__()
        if joints < 1 or not fps > 0 or not period > 0:
            raise ConfigError(f"joints={joints}, fps={fps}, period={period}: give values above 0")
        self.joints, self.period = joints, period
        self.spec = replace(self.spec, fps=fps, states=joints, actions=joints)

    def sample(self, seconds: float) -> NDArray[np.float32]:
        """State and command at a time after opening, s; float32 (2 joints,)."""
        later = seconds + 1 / self.spec.fps
        return np.concatenate([self.state(seconds), self.state(later)])

    def state(self, seconds: float) -> NDArray[np.float32]:
        """State of the joints at a time after opening, s; float32 (joints,)."""
        phase = 2 * np.pi * seconds / self.period + np.arange(self.joints)
        state: NDArray[np.float32] = np.sin(phase).astype(np.float32)
        return state
