"""Units of a sensor: no two look alike. A seed draws one.

Lights differ in strength and colour, gels have dents, scratches and dust, and cameras differ in
noise. What all units of a type share is in `STYLES`.
"""

from __future__ import annotations

import math
import zlib
from dataclasses import dataclass

import torch
import torch.nn.functional as F
from torch import Tensor

from tactileforge.errors import ConfigError, unknown
from tactileforge.sim import lighting
from tactileforge.sim.lighting import Calibration, Lamp, background
from tactileforge.sim.markers import Markers, coverage, grid
from tactileforge.specs import SPECS


@dataclass(frozen=True)
class Unit:
    """One sensor of a type.

    Attributes:
        sensor: Type of the sensor.
        seed: Draws the unit, and the noise of its frames.
        background: float32 (3, H, W), grey levels of the picture with no contact.
        calibration: How the picture answers to the gel's surface.
        spacing: mm per pixel.
        noise: Standard deviation of the camera's noise, grey levels.
        markers: The dots of its gel, if it has any.
    """

    sensor: str
    seed: int
    background: Tensor
    calibration: Calibration
    spacing: float
    noise: float
    markers: Markers | None = None


@dataclass(frozen=True)
class Style:
    """What the units of a type have in common.

    Attributes:
        calibrations: Names of those that ship; a unit has one of them.
        lamps: The lights of a type that has no calibration.
        base: Its light from everywhere, R, G, B.
        dim: See `lighting.lit`.
        markers: Whether its gel has markers, unless told otherwise.
        height_mm: What the picture shows from top to bottom; None takes it from the spec.
        spread: How much units differ: standard deviation of the logarithm of a light's strength.
        clouds: How uneven the light is, grey levels.
        wear: Mean number of scratches, and of specks of dust.
    """

    calibrations: tuple[str, ...] = ()
    lamps: tuple[Lamp, ...] = ()
    base: tuple[float, float, float] = (0.0, 0.0, 0.0)
    dim: float = 0.0
    markers: bool = False
    height_mm: float | None = None
    spread: float = 0.08
    clouds: float = 2.0
    wear: tuple[float, float] = (3.0, 6.0)


def _lamp(degrees: float, colour: tuple[float, float, float], fall: float = 0.5) -> Lamp:
    return Lamp(math.radians(degrees), math.radians(35), colour, fall)


#: DuraGel, GelSlim and DM-Tac: no calibration may be shipped, so their lamps are our choice.
STYLES = {
    "gelsight": Style(("gelsight", "gelsight_fots")),
    "gelsight_mini": Style(("gelsight_mini",)),
    "digit": Style(("digit",), spread=0.15, clouds=9.0, wear=(2.0, 3.0)),
    "gelslim": Style(
        lamps=(
            _lamp(180, (10, 130, 80), 0.8),
            _lamp(-90, (25, 40, 135), 0.8),
            _lamp(40, (160, 40, 55), 0.8),
        ),
        base=(10, 15, 10),
        dim=0.25,
        markers=True,
        height_mm=16.0,
    ),
    "duragel": Style(
        lamps=(
            _lamp(0, (150, 45, 45)),
            _lamp(120, (35, 130, 60)),
            _lamp(-120, (40, 60, 150)),
        ),
        base=(45, 45, 50),
        markers=True,
        height_mm=15.2,
    ),
    "dm": Style(
        lamps=tuple(_lamp(a, (60, 60, 62), 0.25) for a in (0, 90, 180, 270)),
        base=(40, 42, 45),
        markers=True,
        height_mm=15.0,
    ),
}


def draw(
    sensor: str,
    seed: int,
    size: tuple[int, int] | None = None,
    markers: bool | None = None,
) -> Unit:
    """A unit of a sensor; the same seed gives the same unit.

    Args:
        sensor: One of `STYLES`.
        seed: Not negative.
        size: Height and width of its pictures; None for those of the sensor.
        markers: Whether its gel has markers; None as the type has.

    Raises:
        ConfigError: The sensor is unknown, or has no gel with markers.
    """
    if sensor not in STYLES:
        raise ConfigError(unknown("simulated sensor", sensor, STYLES))
    style, spec = STYLES[sensor], SPECS[sensor]
    height, width = size or (spec.height, spec.width)
    height_mm = style.height_mm or (spec.area_mm or (0.0,))[0]
    spacing = height_mm / height
    chance = torch.Generator().manual_seed(zlib.crc32(f"{sensor} {seed}".encode()))
    how = _calibration(style, chance)
    gains = torch.exp(style.spread * torch.randn(3, generator=chance).clamp(-2, 2))
    mixing = gains.diag() + 0.03 * torch.rand(3, 3, generator=chance)
    shares = torch.softmax(4 * torch.randn(len(how.backgrounds), generator=chance), 0)
    still = background(torch.einsum("n,nqc->qc", shares, how.backgrounds), height, width)
    still = torch.einsum("dc,chw->dhw", mixing, still)
    still = still * _gradient(height, width, chance) + _clouds(style.clouds, height, width, chance)
    still = still + _worn(style, height, width, spacing, chance)
    has_markers = style.markers if markers is None else markers
    return Unit(
        sensor=sensor,
        seed=seed,
        background=still.clamp(4, 251),
        calibration=how.coloured(mixing),
        spacing=spacing,
        noise=how.noise * _between(0.7, 1.5, chance),
        markers=grid(sensor).markers(chance) if has_markers else None,
    )


def _between(low: float, high: float, chance: torch.Generator) -> float:
    return low + (high - low) * float(torch.rand((), generator=chance))


def _calibration(style: Style, chance: torch.Generator) -> Calibration:
    if not style.calibrations:
        return lighting.lit(style.lamps, style.base, style.dim)
    which = int(torch.randint(len(style.calibrations), (), generator=chance))
    return lighting.load(style.calibrations[which])


def _gradient(height: int, width: int, chance: torch.Generator) -> Tensor:
    """A factor near 1 that grows slowly in some direction for each colour, (3, H, W)."""
    slope = 0.06 * torch.randn(2, 3, 1, 1, generator=chance)
    x, y = torch.linspace(-1, 1, width), torch.linspace(-1, 1, height)[:, None]
    return slope[0] * x + slope[1] * y + 1


def _clouds(strength: float, height: int, width: int, chance: torch.Generator) -> Tensor:
    """Unevenness of light and gel, grey levels, (3, H, W): broad in colour, fine in all alike."""
    total = torch.zeros(1, 3, height, width)
    for cells, depth, shared in ((4, strength, 0.2), (11, strength / 2, 0.5), (70, 0.4, 0.9)):
        rows = max(2, cells * height // width)
        grain = torch.randn(1, 3, rows, cells, generator=chance)
        grain = (1 - shared) * grain + shared * grain[:, :1]
        total += depth * F.interpolate(grain, (height, width), mode="bicubic")
    return total[0]


def _worn(style: Style, height: int, width: int, spacing: float, chance: torch.Generator) -> Tensor:
    """Scratches and specks of dust, grey levels, (1, H, W)."""
    scratches, specks = (
        int(torch.poisson(torch.tensor(mean), generator=chance)) for mean in style.wear
    )
    extent = torch.tensor([width, height]).float()
    out = torch.zeros(1, height, width)
    for _ in range(scratches):
        start = torch.rand(2, generator=chance) * extent
        angle = _between(0, math.pi, chance)
        length = _between(1, 8, chance) / spacing
        along = torch.linspace(0, 1, max(2, 2 * int(length)))[:, None] * length
        bend = 0.15 * _between(-1, 1, chance) * (along / length) ** 2 * length
        x = start[0] + along * math.cos(angle) - bend * math.sin(angle)
        y = start[1] + along * math.sin(angle) + bend * math.cos(angle)
        radii = torch.full((len(along),), _between(0.02, 0.05, chance) / spacing)
        line = coverage(torch.cat([x, y], 1)[None], radii, height, width)
        out += _between(-7, 5, chance) * line
    if specks:
        centres = torch.rand(1, specks, 2, generator=chance) * extent
        radii = (0.03 + 0.1 * torch.rand(specks, generator=chance)) / spacing
        out += _between(-30, 20, chance) * coverage(centres, radii, height, width)
    return out
