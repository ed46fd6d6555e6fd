"""Simulated wrench sensor, for recording forces without hardware."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from tactileforge.errors import ConfigError
from tactileforge.sensors import ForceTorque
from tactileforge_sim.sensors.sim_samples import SimSamples


class SimWrench(SimSamples):
    """One press per ``period``: normal force ``newton`` (1 - cos) / 2, and a fifth of it as shear.

    It runs in real time.

    Args:
        fps: Samples a second.
        newton: Largest normal force, N.
        period: Seconds from press to press.
        bias: Reading without load, N on every axis.
        rest: Seconds without load after opening, for its tare.

    Attributes:
        spec: Spec of kind ``wrench``, at that rate.
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
        super().__init__()
        if not fps > 0 or not period > 0:
            raise ConfigError(f"fps={fps} and period={period}: give values above 0")
        self.newton, self.period, self.bias, self.rest = newton, period, bias, rest
        self.spec = replace(self.spec, fps=fps)

    def sample(self, seconds: float) -> NDArray[np.float32]:
        """Wrench at a time after opening, s; float32 (6,), N and N m."""
        phase = 2 * math.pi * max(0.0, seconds - self.rest) / self.period
        normal = self.newton * (1 - math.cos(phase)) / 2
        shear = 0.2 * normal
        forces = np.array([shear, 0.0, normal]) + self.bias
        return np.array([*forces, 0.0, 0.01 * shear, 0.0], np.float32)
