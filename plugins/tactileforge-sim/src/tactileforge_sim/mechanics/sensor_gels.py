"""The gel of a type of sensor, and its friction with objects."""

from __future__ import annotations

from dataclasses import dataclass, replace

from tactileforge_depth.gel import Gel

from tactileforge.errors import ConfigError
from tactileforge.specs import simulation

#: Upper limit of simulated frames per second; slower sensors keep their own rate.
FPS = 30.0


@dataclass(frozen=True)
class SensorGel:
    """Mechanical side of a sensor: its gel and the range of its friction.

    Attributes:
        gel: Gel of the type; its friction is drawn for each touch.
        friction: Lowest and highest coefficient of friction; 0.5 and 1.2.
    """

    gel: Gel
    friction: tuple[float, float] = (0.5, 1.2)

    def touched(self, grip: float) -> Gel:
        """The gel under a slippery (0) to a sticky (1) object."""
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
