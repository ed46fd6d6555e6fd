"""Simulation of types of sensors: gel, light and markers, as data."""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class Lamp:
    """A light at the side of the gel.

    Attributes:
        azimuth: Direction, rad, clockwise from the right of the image.
        elevation: Angle of its light to the gel at rest, rad.
        colour: Grey levels added to R, G, B of a surface facing it.
        fall: Loss of light from its edge of the image to the centre, as a share.
        shadow: Loss of light in its shadow, as a share.

    Example:
        >>> red = Lamp(azimuth=0.0, elevation=0.5, colour=(90.0, 0.0, 0.0))
        >>> red.fall, red.shadow
        (0.3, 0.3)
    """

    azimuth: float
    elevation: float
    colour: tuple[float, float, float]
    fall: float = 0.3
    shadow: float = 0.3


@dataclass(frozen=True)
class MarkerPattern:
    """Printed markers: rows and columns of dots, or dots anywhere (speckle).

    Attributes:
        columns: Number of dots from left to right.
        rows: Number of dots from top to bottom.
        pitch: Distance between dots, right and down, mm.
        radius: Radius of the dots, mm.
        jitter: Standard deviation of the positions of dots, mm.

    Example:
        >>> dots = MarkerPattern(columns=9, rows=7, pitch=(1.8, 1.8), radius=0.3)
        >>> dots.columns * dots.rows
        63
    """

    columns: int
    rows: int
    pitch: tuple[float, float]
    radius: float
    jitter: float = 0.02


@dataclass(frozen=True, kw_only=True)
class Simulation:
    """Simulation of a type of sensor; without lamps or calibration, its gel is dark.

    Attributes:
        dome: Radius of curvature of the gel at rest, mm; None for a flat gel.
        thickness: Thickness of the gel, mm.
        modulus: Young's modulus of the gel, MPa.
        friction: Smallest and largest coefficient of friction between gel and objects.
        calibrations: Names of shipped optical calibrations; a unit has one of them.
        lamps: Lights of a type without calibration.
        base: Ambient light of a type without calibration, R, G, B in grey levels.
        dim: Loss of light towards the border, as a share, see
            `depth.lighting.lamp_calibration`.
        height_mm: Height of the field of view, mm; None takes it from the sensing area.
        level: Mean R, G, B of a background, for cameras with automatic colours; None leaves them
            to the lights.
        clouds: Unevenness of the light, grey levels.
        wear: Mean number of scratches, and of specks of dust.
        pattern: Printed markers of its marker gel; None without such a gel.
        markers: Whether units have the marker gel by default.

    Example:
        >>> gel = Simulation(thickness=3.0, lamps=(Lamp(0.0, 0.5, (90.0, 0.0, 0.0)),))
        >>> gel.dome is None, len(gel.lamps)
        (True, 1)
    """

    dome: float | None = None
    thickness: float = 4.0
    modulus: float = 0.435
    friction: tuple[float, float] = (0.5, 1.2)
    calibrations: tuple[str, ...] = ()
    lamps: tuple[Lamp, ...] = ()
    base: tuple[float, float, float] = (0.0, 0.0, 0.0)
    dim: float = 0.0
    height_mm: float | None = None
    level: tuple[float, float, float] | None = None
    clouds: float = 2.0
    wear: tuple[float, float] = (3.0, 6.0)
    pattern: MarkerPattern | None = None
    markers: bool = False


def _lamp(degrees: float, colour: tuple[float, float, float], fall: float = 0.5) -> Lamp:
    # 35 degrees is our choice, as are these lamps: LEDs at the side of a gel shine flat over it
    return Lamp(math.radians(degrees), math.radians(35), colour, fall)


#: Simulations of the published sensors. Published are thickness, stiffness and curvature of the gel
#: of the GelSight Mini (FEATS), a curvature of DIGIT's (TACTO), and the thickness of a lab
#: GelSight's; other gels take the Mini's thickness and stiffness. Ranges of friction are our
#: choice; ToucHD's demonstrations show at least 1.2 on a Mini and 0.55 on a DIGIT. No calibration
#: of DuraGel, GelSlim and DM-Tac may be shipped, so their lamps are our choice. GelSight's marker
#: gel has 11 x 9 dots, the Mini's dots of 1 mm, 2.4 mm apart, DM-Tac's a dense speckle.
PUBLISHED = {
    "gelsight": Simulation(
        calibrations=("gelsight", "gelsight_fots"),
        pattern=MarkerPattern(11, 9, (1.7, 1.55), 0.25),
    ),
    # mean levels of eight real units: their cameras balance colours, and differ by 4 grey levels
    "digit": Simulation(
        dome=100.0,
        friction=(0.4, 1.1),
        calibrations=("digit",),
        level=(98.0, 104.0, 97.0),
        clouds=5.0,
        wear=(2.0, 3.0),
    ),
    "gelsight_mini": Simulation(
        dome=106.6,
        friction=(0.8, 1.4),
        calibrations=("gelsight_mini",),
        pattern=MarkerPattern(9, 7, (2.4, 2.4), 0.5),
    ),
    "gelslim": Simulation(
        lamps=(
            _lamp(180, (10, 130, 80), 0.8),
            _lamp(-90, (25, 40, 135), 0.8),
            _lamp(40, (160, 40, 55), 0.8),
        ),
        base=(10, 15, 10),
        dim=0.25,
        height_mm=16.0,
        pattern=MarkerPattern(16, 12, (1.4, 1.4), 0.14, 0.03),
        markers=True,
    ),
    "duragel": Simulation(
        lamps=(
            _lamp(0, (150, 45, 45)),
            _lamp(120, (35, 130, 60)),
            _lamp(-120, (40, 60, 150)),
        ),
        base=(45, 45, 50),
        height_mm=15.2,
        pattern=MarkerPattern(14, 11, (1.45, 1.45), 0.2),
        markers=True,
    ),
    "dm": Simulation(
        lamps=tuple(_lamp(a, (60, 60, 62), 0.25) for a in (0, 90, 180, 270)),
        base=(40, 42, 45),
        height_mm=15.0,
        pattern=MarkerPattern(34, 26, (0.6, 0.6), 0.13, 0.13),
        markers=True,
    ),
}
