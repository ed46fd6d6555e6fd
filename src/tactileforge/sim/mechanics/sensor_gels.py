"""The gel of a type of sensor, as objects meet it."""

from __future__ import annotations

from dataclasses import dataclass, replace

from tactileforge.errors import ConfigError
from tactileforge.sensors.specs import simulation
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


#: Radius of curvature (mm) of the most domed gel: scenes start and end off such a gel.
MOST_DOMED = 100.0


def sensor_gel(name: str) -> SensorGel:
    """The gel of a sensor type.

    Raises:
        ConfigError: The type is not simulated, or its gel is more domed than a scene allows for.
    """
    known = simulation(name)
    if known.dome is not None and known.dome < MOST_DOMED:
        raise ConfigError(f"{name}: dome is {known.dome} mm; give {MOST_DOMED:g} mm or more")
    gel = Gel(dome=known.dome, thickness=known.thickness, modulus=known.modulus)
    return SensorGel(gel, known.friction)
