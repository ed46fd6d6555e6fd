"""The gels of the sensors.

Published are thickness, stiffness and curvature of the GelSight Mini's gel (FEATS), a curvature of
DIGIT's (TACTO) and the thickness of a lab GelSight's. Of the other gels nothing is: they take the
Mini's thickness and stiffness. Ranges of friction are our choice; ToucHD's demonstrations show at
least 1.2 on a Mini and 0.55 on a DIGIT.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from tactileforge.errors import ConfigError, unknown
from tactileforge.sim.mechanics.gel import Gel

#: Frames per second are those of the sensor, but not more.
FPS = 30.0


@dataclass(frozen=True)
class SensorGel:
    """Mechanical side of a sensor: its gel, as the pressing object meets it.

    Attributes:
        gel: Its gel; the friction of a touch is drawn from the range.
        friction: Lowest and highest coefficient.
    """

    gel: Gel
    friction: tuple[float, float] = (0.5, 1.2)

    def touched(self, grip: float) -> Gel:
        """The gel when it is touched by a slippery (0) to a sticky (1) object."""
        low, high = self.friction
        return replace(self.gel, friction=low + grip * (high - low))


DEVICES = {
    "gelsight": SensorGel(Gel()),
    "digit": SensorGel(Gel(dome=100.0), (0.4, 1.1)),
    "gelsight_mini": SensorGel(Gel(dome=106.6), (0.8, 1.4)),
    "gelslim": SensorGel(Gel()),
    "duragel": SensorGel(Gel()),
    "dm": SensorGel(Gel()),
}


def sensor_gel(name: str) -> SensorGel:
    """The device of a sensor type.

    Raises:
        ConfigError: Its gel is not known; lists those that are.
    """
    if name not in DEVICES:
        raise ConfigError(unknown("simulated sensor", name, DEVICES))
    return DEVICES[name]
