"""Simulations of the published types of sensors, as data."""

from __future__ import annotations

import math

from tactileforge.contracts import Lamp, MarkerPattern, Simulation


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
