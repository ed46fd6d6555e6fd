"""Domain randomisation: one table of the differences between units of a sensor and between scenes.

A row of `TABLE` holds one randomised quantity, its range, and the source of the range.
`randomise=none|unit|all` chooses rows by their scope; any rows can be chosen by name. A row not
chosen has its neutral value. Rows of looks also differ between units, but only ``all`` has them.
Each row is drawn from a generator of its own: choosing one more does not change the others.
"""

from __future__ import annotations

import zlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

_CHOSEN = "our choice"
_REAL = "backgrounds and touches of the public samples"
_BORDERS = "borders of pictures of three real Minis"
_SHEARED = "change of the whole picture by shear, real and simulated"
_OBJECTS = "everyday objects of the public samples, by eye"
_DIGITS = "touches of four real DIGITs of the public samples, by eye"


@dataclass(frozen=True)
class RandomisedQuantity:
    """One randomised quantity, with its range.

    Attributes:
        name: Name in options.
        scope: ``unit`` and ``look`` for one draw per unit of a sensor, ``scene`` for one per scene.
        what: Description, with its unit.
        low: Lowest value.
        high: Highest value.
        neutral: Value without randomisation.
        source: Source of the range.
        log: Whether the logarithm is uniform, instead of the value.
        share: Probability of a random value; otherwise it is neutral.
        sensors: Lowest and highest value by sensor, for sensors with ranges of their own.
    """

    name: str
    scope: Literal["unit", "look", "scene"]
    what: str
    low: float
    high: float
    neutral: float
    source: str = _CHOSEN
    log: bool = False
    share: float = 1.0
    sensors: Mapping[str, tuple[float, float]] = field(default_factory=dict)

    def draw(self, seed: int, sensor: str = "") -> float:
        """A value; the same seed and sensor give the same one."""
        chance = rng(seed, self.name, sensor)
        low, high = self.sensors.get(sensor, (self.low, self.high))
        differs, place = chance.random(2)
        if differs >= self.share:
            return self.neutral
        if self.log:
            return float(low * (high / low) ** place)
        return float(low + (high - low) * place)


def rng(seed: int, name: str, sensor: str = "") -> np.random.Generator:
    """A generator seeded by a seed, a name and a sensor."""
    return np.random.default_rng([seed, zlib.crc32(f"{name} {sensor}".encode())])


def _unit(
    name: str, what: str, low: float, high: float, neutral: float, **more: Any
) -> RandomisedQuantity:
    return RandomisedQuantity(name, "unit", what, low, high, neutral, **more)


def _look(name: str, what: str, neutral: float, source: str, **more: Any) -> RandomisedQuantity:
    """A row for the named sensors, neutral on all others."""
    return RandomisedQuantity(name, "look", what, neutral, neutral, neutral, source, **more)


def _scene(
    name: str, what: str, low: float, high: float, neutral: float, **more: Any
) -> RandomisedQuantity:
    return RandomisedQuantity(name, "scene", what, low, high, neutral, **more)


TABLE: dict[str, RandomisedQuantity] = {
    row.name: row
    for row in (
        # the gel
        _unit("stiffness", "modulus of the gel, over the type's", 0.6, 1.6, 1.0, log=True),
        _unit(
            "thickness",
            "thickness of the gel, over the type's, in steps of an eighth",
            0.75,
            1.25,
            1.0,
        ),
        _unit(
            "dome", "radius of curvature of a domed gel, over the type's", 0.7, 2.0, 1.0, log=True
        ),
        # its lights
        _unit(
            "specimen",
            "spread over the calibrated units, their backgrounds and white balances",
            1.0,
            1.0,
            0.0,
            source=_REAL,
        ),
        _unit("light_turn", "direction of each colour's light, rad either way", 0.0, 0.25, 0.0),
        _unit(
            "light_power",
            "power of each colour's light: deviation of its logarithm",
            0.03,
            0.15,
            0.0,
        ),
        _unit(
            "light_colour",
            "share of each colour's light that the camera's other channels see",
            0.0,
            0.12,
            0.0,
        ),
        _unit(
            "contrast",
            "change of the picture for the same dent, over the calibrated unit's",
            0.6,
            1.2,
            1.0,
            log=True,
            sensors={"gelsight_mini": (0.4, 1.1), "digit": (0.8, 2.4)},
            source="in-contact change, grey levels: real Minis 11.5 to 24.8, calibrated 25.8; "
            "real DIGITs 15 to 37, calibrated 9",
        ),
        _unit(
            "shadow",
            "darkness of cast shadows, over the calibration's",
            1.0,
            1.0,
            1.0,
            sensors={"digit": (0.8, 2.5)},
            source=_DIGITS,
        ),
        _unit(
            "face",
            "colour of the coating pressed flat: deviation of R, G, B, grey levels",
            0.0,
            0.0,
            0.0,
            sensors={"digit": (4.0, 12.0)},
            source=_DIGITS,
        ),
        _unit(
            "cones",
            "stray light of a lamp in a cone across the picture, grey levels at the lamp",
            0.0,
            0.0,
            0.0,
            sensors={"digit": (40.0, 160.0)},
            source=_DIGITS,
        ),
        _unit(
            "hot_spots",
            "light of a lamp in the picture, grey levels in its middle",
            0.0,
            0.0,
            0.0,
            sensors={"digit": (0.0, 80.0)},
            source=_DIGITS,
        ),
        _unit(
            "unevenness",
            "slow variation of the background, over the type's",
            0.5,
            1.5,
            0.0,
            source=_REAL,
        ),
        # its camera
        _unit(
            "exposure",
            "brightness of the whole picture, factor",
            0.88,
            1.12,
            1.0,
            log=True,
            source=_REAL,
        ),
        _unit(
            "gamma",
            "exponent of the camera's tone curve, over the calibrated unit's",
            0.85,
            1.18,
            1.0,
            log=True,
        ),
        _unit(
            "blur",
            "focus: deviation of a Gaussian, pixels of a picture of 240 rows or columns",
            0.5,
            1.6,
            0.0,
            sensors={"digit": (2.0, 4.5)},
            source="fall of the spectrum of real changes, see the comparison with real sets",
        ),
        _unit(
            "distortion",
            "radial distortion: share by which a corner of the picture is displaced",
            -0.06,
            0.06,
            0.0,
        ),
        _unit(
            "scale",
            "mm per pixel, over the type's",
            0.92,
            1.08,
            1.0,
            log=True,
            source="DIGIT: 18.6 to 19.6 pixels per mm in two publications, 0.0266 mm in a third",
        ),
        _unit(
            "noise",
            "camera noise, over the calibration's",
            0.7,
            1.5,
            1.0,
            sensors={"digit": (1.0, 2.2), "gelsight_mini": (0.8, 2.0)},
            source="DIGIT 1.65 grey levels measured, 0.88 in the calibration; Mini 0.59 and 0.41",
        ),
        _unit(
            "jpeg",
            "JPEG quality that is missing to 100, at the sensor's own resolution",
            3.0,
            30.0,
            0.0,
            share=0.7,
        ),
        _unit(
            "mpeg",
            "the same of the change from frame to frame, as a video codec stores it",
            10.0,
            50.0,
            0.0,
            share=0.25,
        ),
        # its markers, and its wear
        _unit("marker_pitch", "distance of markers, over the type's", 0.75, 1.25, 1.0),
        _unit("marker_size", "radius of markers, over the type's", 0.6, 1.3, 1.0),
        _unit(
            "marker_contrast",
            "share of the light that a marker blocks, over the type's",
            0.6,
            1.08,
            1.0,
        ),
        _unit("marker_loss", "share of markers that are missing", 0.0, 0.06, 0.0),
        _unit(
            "wear",
            "numbers of scratches and specks of dust, over the type's",
            0.0,
            2.5,
            0.0,
            source=_REAL,
        ),
        # the looks of a unit
        _look(
            "frame",
            "darkness of a rounded frame around the gel, as a share of the light",
            0.0,
            _BORDERS,
            share=0.5,
            sensors={"gelsight_mini": (0.3, 0.9)},
        ),
        _look(
            "glow",
            "light of a lamp at a side of the gel, grey levels",
            0.0,
            _BORDERS,
            share=0.5,
            sensors={"gelsight_mini": (5.0, 70.0)},
        ),
        _look(
            "balance",
            "share of the way from a unit's mean colour to that of real ones",
            0.0,
            "mean R, G, B of six real Minis: 49 to 83, 94 to 124, 97 to 126",
            sensors={"gelsight_mini": (0.6, 1.0)},
        ),
        _look(
            "slope",
            "slope of the gel for the same colour, over the calibrated unit's",
            1.0,
            _SHEARED,
            log=True,
            sensors={"gelsight_mini": (1.0, 4.0), "digit": (1.0, 2.5)},
        ),
        _look(
            "halo",
            "scattered light of a dent, over the calibrated unit's",
            1.0,
            _SHEARED,
            sensors={"gelsight_mini": (0.0, 0.4), "digit": (0.1, 0.6)},
        ),
        _look(
            "vivid",
            "change of the picture for the same dent, over that of contrast",
            1.0,
            "in-contact change, real and simulated: DIGITs 15 to 37 grey levels and 11",
            sensors={"digit": (1.2, 2.4), "gelsight_mini": (0.45, 0.9)},
        ),
        _look(
            "dim",
            "light that the coating loses where it is pressed flat, grey levels",
            0.0,
            "mean change of real DIGITs' pictures: negative in green and blue",
            sensors={"digit": (0.0, 25.0)},
        ),
        _look(
            "haze",
            "share of the light common to all colours that is missing",
            0.0,
            _DIGITS,
            sensors={"digit": (0.0, 0.3)},
        ),
        _look(
            "streaks",
            "streaks in the cones and light of their arcs, over that of the cones",
            0.0,
            _DIGITS,
            sensors={"digit": (0.1, 0.6)},
        ),
        _look(
            "specks",
            "number of bright and dark specks, sharp whatever the focus",
            0.0,
            _DIGITS,
            sensors={"digit": (0.0, 8.0), "gelsight_mini": (0.0, 5.0)},
        ),
        # the moment
        _scene(
            "drift",
            "slow change of the light of each colour over a scene, grey levels either way",
            0.0,
            2.0,
            0.0,
        ),
        _scene(
            "viscosity",
            "relaxation time of the gel, s",
            0.0,
            0.2,
            0.0,
            source="lag of pictures behind forces in ToucHD's demonstrations: 0.06 and 0.2 s",
        ),
        _scene(
            "jitter",
            "deviation of the times of frames from their even grid, s",
            0.0,
            0.006,
            0.0,
            source="GelSight Mini on Linux: 18 to 25 frames a second",
        ),
        # the object, and the hand
        _scene(
            "tilt",
            "slope of the object against the gel along x and y: deviation",
            0.01,
            0.05,
            0.015,
        ),
        _scene(
            "roughness",
            "standard deviation of the heights of a rough object, mm; waves of 0.5 to 4 mm",
            0.001,
            0.01,
            0.0,
            share=0.5,
        ),
        _scene(
            "print_lines",
            "distance of the lines that a printer left, mm; they are 2 % as deep",
            0.3,
            1.0,
            0.0,
            share=0.5,
            source="printed punches of ToucHD's demonstrations: about 0.8 mm",
        ),
        _scene(
            "worn",
            "radius over which an object's edges are worn, mm",
            0.03,
            0.25,
            0.0,
            share=0.6,
            source=_OBJECTS,
        ),
        _scene(
            "warp",
            "deviation of an object's outlines from their nominal places, mm",
            0.02,
            0.3,
            0.0,
            log=True,
            share=0.5,
            source=_OBJECTS,
        ),
        _scene(
            "grain",
            "standard deviation of the heights of a grained object, mm; waves of 0.2 to 1.6 mm",
            0.002,
            0.02,
            0.0,
            log=True,
            share=0.6,
            source=_OBJECTS,
        ),
        _scene(
            "softness",
            "how far the object itself yields, mm/MPa (the Mini's gel: about 4)",
            0.1,
            12.0,
            0.0,
            log=True,
            share=0.4,
        ),
        _scene(
            "force_follows_shear",
            "slope of the path against the gel, mm per mm of slide",
            -0.06,
            0.06,
            0.0,
            source="ToucHD's demonstrations, Mini: -Fz = 2.93 + 0.19 Fx - 0.19 Fy N",
        ),
        _scene(
            "sway",
            "unsteady hand: share of the depth, and tenths of a mm sideways",
            0.0,
            0.2,
            0.0,
            source="normal force of ToucHD's slides: deviation 0.6 N of 2.9 (Mini), 1 N (DIGIT)",
        ),
    )
}
#: Rows that bring pictures nearer to real ones, added after the weights that ship were trained.
NEARER = frozenset(
    {"worn", "warp", "grain"} | {x.name for x in TABLE.values() if x.scope == "look"}
)
