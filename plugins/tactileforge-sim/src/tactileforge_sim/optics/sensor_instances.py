"""Units of a sensor, each drawn from a seed and different from the others.

The table of `randomise` gives the differences between units; `Simulation` gives
the properties shared by all units of a type.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import torch
import torch.nn.functional as F
from tactileforge_depth import lighting
from tactileforge_depth.gel import Gel
from tactileforge_depth.lighting import OpticalCalibration, polynomial_background
from torch import Tensor

from tactileforge.contracts import Simulation
from tactileforge.errors import ConfigError, unknown
from tactileforge.specs import SIMULATED, pixel_spacing, simulation, spec
from tactileforge_sim.optics.border import border
from tactileforge_sim.optics.camera import FULL, CameraModel
from tactileforge_sim.optics.markers import Markers, coverage, print_markers
from tactileforge_sim.optics.stray_light import stray_light
from tactileforge_sim.randomise.draw import Choice, RandomDraw

#: Sides of the red, green and blue light of a DIGIT with streaks, rad, clockwise from the right;
#: part of `cones` that its cones have, and their least light, grey levels.
_SIDES = (math.radians(185), math.radians(-10), math.radians(90))
_STREAKED = (0.7, 40.0)
#: Power of `slope` by which the picture changes more.
_FULLER = 0.6
#: Parts of the R, G and B of `dim` that pressed coating loses.
_LOST = (0.1, 1.0, 1.0)
#: Least and largest mean R, G and B of the backgrounds of real Minis.
_LEVELS = ((49.0, 94.0, 97.0), (83.0, 124.0, 126.0))
#: Share of specks that are dark, and their light and that of the brightest, grey levels.
_DARK, _SPECK = 0.4, (-25.0, 90.0)


@dataclass(frozen=True)
class SensorInstance:
    """One sensor of a type.

    Attributes:
        sensor: Type of the sensor.
        seed: Seed of the unit and of the noise of its frames.
        background: float32 (3, H, W), grey levels of the image with no contact.
        calibration: Response of the image to the gel's surface.
        spacing: Width of a pixel, mm.
        noise: Standard deviation of the camera's noise, grey levels.
        markers: Markers of its gel; None without.
        face: Change of R, G, B where the coating is pressed deep, grey levels.
        slope: Slope of the gel for the same colour, over the calibration's.
        seen: float32 (H, W), share of the light that passes a frame; None without a frame.
        specks: float32 (3, H, W), sharp specks, grey levels; None without.
        camera: Focus, exposure, tone curve, distortion and codec.
    """

    sensor: str
    seed: int
    background: Tensor
    calibration: OpticalCalibration
    spacing: float
    noise: float
    markers: Markers | None = None
    face: tuple[float, float, float] = (0.0, 0.0, 0.0)
    slope: float = 1.0
    seen: Tensor | None = None
    specks: Tensor | None = None
    camera: CameraModel = field(default_factory=CameraModel)


def draw_instance(
    sensor: str,
    seed: int,
    size: tuple[int, int] | None = None,
    markers: bool | None = None,
    randomise: Choice = "unit",
) -> SensorInstance:
    """A unit of a sensor; the same seed gives the same unit.

    Args:
        sensor: Type of the sensor.
        seed: Seed of the unit, 0 or more.
        size: Height and width of its images; None for those of the sensor.
        markers: Whether its gel has markers; None for the type's default.
        randomise: Differences between units, see `randomise.draw.randomised_rows`.

    Raises:
        ConfigError: The sensor is not simulated, or ``markers`` is True for a type without them.
    """
    style, known = simulation(sensor), spec(sensor)
    height, width = size or (known.height, known.width)
    row = RandomDraw(randomise, seed, sensor)
    scale = pixel_spacing(sensor, height) * row["scale"]
    how = _calibration(style, row)
    mixing = _mixing(row)
    # a blend of the measured backgrounds; 4 makes most units resemble one or two of them
    shares = torch.softmax(
        4 * row["specimen"] * _randn(row, "backgrounds", len(how.backgrounds)), 0
    )
    still = polynomial_background(torch.einsum("n,nqc->qc", shares, how.backgrounds), height, width)
    still = torch.einsum("dc,chw->dhw", mixing, still) * _gradient(height, width, row)
    still = still + _clouds(style.clouds, height, width, row)
    cones, streaks, lights = row["cones"], row["streaks"], how.lights
    if streaks:
        # a calibration's lights are those of its shadows; real cones lie where its background is
        # bright in their colour
        cones, lights = max(_STREAKED[0] * cones, _STREAKED[1]), _SIDES
    if lights and (cones or row["hot_spots"]):
        chance, spots = _chance(row, "stray light"), row["hot_spots"]
        lines = _chance(row, "streaks") if streaks else None
        still += stray_light((height, width), lights, cones, spots, chance, streaks, lines)
    still = still - row["haze"] * still.amin(0).clamp(min=0)
    still = _levelled(still, style, row)
    if row["balance"]:
        still, gains = _balance(still, row)
        mixing = gains * mixing
    still = still + _worn(style, height, width, scale, row)
    seen = None
    if row["frame"] or row["glow"]:
        seen, glow = border(
            (height, width), row["frame"], row["glow"], _chance(row, "frame"), _chance(row, "glow")
        )
        still = seen * still + glow
    has_markers = style.markers if markers is None else markers
    lost = row["dim"] * torch.tensor(_LOST)
    return SensorInstance(
        sensor=sensor,
        seed=seed,
        # inside 0..255, so that noise is not cut off on one side and the background not saturated
        background=still.clamp(4, 251),
        calibration=how.coloured(mixing),
        spacing=scale,
        noise=how.noise * row["noise"],
        markers=_markers(sensor, style, row) if has_markers else None,
        face=tuple((row["face"] * _randn(row, "face", 3).clamp(-2, 2) - lost).tolist()),
        slope=row["slope"],
        seen=seen,
        specks=_specks(height, width, row) if row["specks"] else None,
        camera=CameraModel(**{name: row[name] for name in CameraModel.__dataclass_fields__}),
    )


def instance_gel(base: Gel, sensor: str, seed: int, randomise: Choice) -> Gel:
    """The gel of a unit, from its type's gel.

    Thickness comes in steps of an eighth, so that units share kernels and batches of the solver.
    """
    row = RandomDraw(randomise, seed, sensor)
    return replace(
        base,
        modulus=base.modulus * row["stiffness"],
        thickness=base.thickness * round(8 * row["thickness"]) / 8,
        dome=None if base.dome is None else base.dome * row["dome"],
    )


def _chance(row: RandomDraw, name: str) -> torch.Generator:
    return torch.Generator().manual_seed(int(row.rng(name).integers(1 << 62)))


def _randn(row: RandomDraw, name: str, *shape: int) -> Tensor:
    return torch.randn(shape, generator=_chance(row, name))


def _between(low: float, high: float, chance: torch.Generator) -> float:
    return low + (high - low) * float(torch.rand((), generator=chance))


def _calibration(style: Simulation, row: RandomDraw) -> OpticalCalibration:
    if not style.calibrations:
        if not style.lamps:
            raise ConfigError("a simulation has lamps, or the names of calibrations: it is dark")
        how = lighting.lamp_calibration(style.lamps, style.base, style.dim)
    else:
        which = row.rng("calibration").integers(len(style.calibrations)) if row["specimen"] else 0
        how = lighting.load_optics(style.calibrations[which])
    angles = row["light_turn"] * row.rng("light_turn").uniform(-1, 1, 3)
    how = how.turned(angles.tolist())
    # gentler slopes of a stronger picture: its colours are fuller at edges, and less far from them
    gain = row["contrast"] * row["vivid"] * row["slope"] ** _FULLER
    return how.scattered(row["halo"]).contrasted(gain).shadowed(row["shadow"])


def _mixing(row: RandomDraw) -> Tensor:
    """Mixing matrix (3, 3) of the channels for a unit's strengths and colours of lights."""
    gains = torch.exp(row["light_power"] * _randn(row, "light_power", 3).clamp(-2, 2))
    share = row["light_colour"] * torch.from_numpy(row.rng("light_colour").random((3, 3))).float()
    share = share * (1 - torch.eye(3))
    return (torch.eye(3) + share - torch.diag(share.sum(1))) * gains


def _gradient(height: int, width: int, row: RandomDraw) -> Tensor:
    """Factors near 1 with a linear gradient in a random direction per colour, (3, H, W)."""
    slope = 0.06 * row["unevenness"] * _randn(row, "gradient", 2, 3, 1, 1)
    x, y = torch.linspace(-1, 1, width), torch.linspace(-1, 1, height)[:, None]
    return slope[0] * x + slope[1] * y + 1


def _levelled(still: Tensor, style: Simulation, row: RandomDraw) -> Tensor:
    """The background after the camera's white balance, if the type has one, (3, H, W)."""
    if style.level is None:
        return still
    wanted = torch.tensor(style.level) + 4 * row["specimen"] * _randn(row, "level", 3)
    return still * (wanted / still.mean((1, 2)))[:, None, None]


def _balance(still: Tensor, row: RandomDraw) -> tuple[Tensor, Tensor]:
    """Background near real mean levels, (3, H, W), and gains of its channels, (3, 1)."""
    low, high = torch.tensor(_LEVELS)[..., None, None]
    share = row["balance"]
    wanted = low + (high - low) * torch.from_numpy(row.rng("balance").random((3, 1, 1))).float()
    mean = still.mean((1, 2), keepdim=True).clamp(min=1)
    # half by the colour of the lights, half by an even light
    gains = (wanted / mean) ** (share / 2)
    level = gains * mean + share * (wanted - gains * mean)
    return gains * (still - mean) + level, gains.flatten(1)


def _specks(height: int, width: int, row: RandomDraw) -> Tensor:
    """Bright specks of one colour and dark ones of all, grey levels, (3, H, W)."""
    chance = _chance(row, "specks")
    out = torch.zeros(3, height, width)
    for _ in range(round(row["specks"])):
        place, size, bright, colour = (torch.rand(n, generator=chance) for n in (2, 1, 1, 3))
        centre = (place * torch.tensor([width, height]))[None, None]
        # one to three pixels of a full picture
        radius = (0.4 + 1.1 * size**2) * min(height, width) / FULL
        disc = coverage(centre, radius, height, width)[0]
        light = torch.full((3,), _SPECK[0])
        if bright > _DARK:
            strength = _SPECK[1] * (bright - _DARK) / (1 - _DARK)
            light = strength * torch.where(colour > colour.amax() - 0.3, 1.0, 0.2)
        out += light[:, None, None] * disc
    return out


def _clouds(strength: float, height: int, width: int, row: RandomDraw) -> Tensor:
    """Unevenness of light and gel, grey levels, (3, H, W): broad per colour, fine in all alike."""
    chance = _chance(row, "clouds")
    total = torch.zeros(1, 3, height, width)
    for cells, depth, shared in ((4, strength, 0.2), (11, strength / 2, 0.5), (70, 0.4, 0.9)):
        rows = max(2, cells * height // width)
        grain = torch.randn(1, 3, rows, cells, generator=chance)
        grain = (1 - shared) * grain + shared * grain[:, :1]
        total += depth * F.interpolate(grain, (height, width), mode="bicubic")
    return row["unevenness"] * total[0]


def _markers(sensor: str, style: Simulation, row: RandomDraw) -> Markers:
    """The markers of one gel, some of them missing."""
    if (pattern := style.pattern) is None:
        having = [name for name in SIMULATED if simulation(name).pattern]
        raise ConfigError(
            unknown("marker gel", sensor, having, "Draw the unit with markers=False.")
        )
    pitch = row["marker_pitch"]
    # A finer pitch needs more markers to cover the same gel, and smaller ones to stay apart.
    near = replace(
        pattern,
        pitch=(pattern.pitch[0] * pitch, pattern.pitch[1] * pitch),
        radius=pattern.radius * row["marker_size"] * min(1.0, pitch),
        columns=round(pattern.columns / min(1.0, pitch)),
        rows=round(pattern.rows / min(1.0, pitch)),
    )
    made = print_markers(near, _chance(row, "markers"))
    kept = torch.from_numpy(row.rng("marker_loss").random(len(made.places))) >= row["marker_loss"]
    opacity = min(1.0, made.opacity * row["marker_contrast"])
    return replace(made, places=made.places[kept], radii=made.radii[kept], opacity=opacity)


def _worn(style: Simulation, height: int, width: int, spacing: float, row: RandomDraw) -> Tensor:
    """Scratches and specks of dust, grey levels, (1, H, W)."""
    chance = _chance(row, "wear")
    scratches, specks = (
        int(torch.poisson(row["wear"] * torch.tensor(mean), generator=chance))
        for mean in style.wear
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
