"""A touch from a seed: shape, motion, and the disturbances of sensor and hand."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np
import torch
from numpy.typing import NDArray
from tactileforge_depth.gel import Gel

from tactileforge.errors import ConfigError, unknown
from tactileforge.specs import SIMULATED, simulation, spec
from tactileforge_sim.geometry.heightfields import covered, rough, warped, worn
from tactileforge_sim.geometry.indenter_geometry import printed
from tactileforge_sim.geometry.shapes import Shape
from tactileforge_sim.mechanics.motions import CLEAR, MOTIONS, Path, Speeds, Sway
from tactileforge_sim.mechanics.sensor_gels import FPS
from tactileforge_sim.mechanics.touch import contacts, window
from tactileforge_sim.randomise.draw import Choice, RandomDraw
from tactileforge_sim.randomise.table import TABLE

#: The solver's grid: points a side, mm between them. It is 14.4 mm wide.
POINTS, SPACING = 72, 0.2
#: Depths (mm) at which the force of a shape is computed; no press goes deeper than the last.
_DEPTHS = (0.05, 0.1, 0.2, 0.35, 0.55, 0.8, 1.1, 1.5)
#: Number of waves of an unsteady hand, their range of frequencies (Hz), and their amplitudes in a
#: pose, mm and rad, for ``sway`` of 1; the amplitude of depth is a share of the deepest.
_WAVES, _HERTZ, _SWAY = 4, (0.4, 4.0), (0.25, 0.25, 0.02, 0.5, 0.015, 0.015)
#: Depth of printed lines over their distance.
_PRINT = 0.02
#: How much finer the waves of grain are than those of roughness.
_FINER = 2.5
#: Radii (mm) of curvature of the published gels and of their most domed units; None is flat. They
#: include the most domed gel of any sensor, `sensor_gels.MOST_DOMED`.
_DOMES = (
    None,
    *sorted(
        {
            dome * factor
            for dome in (simulation(name).dome for name in SIMULATED)
            if dome
            for factor in (TABLE["dome"].low, 1.0)
        }
    ),
)


@dataclass(frozen=True, kw_only=True)
class Scene:
    """One touch, apart from the sensor.

    Attributes:
        seed: Seed of the sensors' units and of their noise; names the touch in errors.
        shape: The object.
        path: Its motion.
        motion: Name of the motion.
        grip: Friction of the object, from slippery (0) to sticky (1); 0.5.
        unit: Seed of the sensors' units; None for ``seed``.
        randomise: Differences between units and scenes, see `randomise.draw.randomised_rows`.
    """

    seed: int
    shape: Shape
    path: Path
    motion: str
    grip: float = 0.5
    unit: int | None = None
    randomise: Choice = "unit"

    def times(self, fps: float) -> NDArray[np.float64]:
        """Nominal times of the frames, s."""
        return np.arange(int(self.path.seconds * fps) + 1) / fps

    def poses(self, fps: float) -> NDArray[np.float64]:
        """Poses of the object at the frames, (T, 6), with jitter of the frames' times."""
        times = self.times(fps)
        late = self.row["jitter"] * self.row.rng("jitter").standard_normal(len(times)).clip(-2, 2)
        return self.path.pose(times + late)

    def drift(self, fps: float) -> NDArray[np.float32]:
        """Change of the light of each colour, grey levels (T, 3)."""
        draw = self.row.rng("drift")
        phase, turns = draw.uniform(0, 2 * np.pi, 3), draw.uniform(0.2, 1.0, 3)
        times = self.times(fps)[:, None] / max(1e-6, self.path.seconds)
        waves = np.sin(2 * np.pi * turns * times + phase) - np.sin(phase)
        return np.asarray(self.row["drift"] * waves, np.float32)

    @property
    def row(self) -> RandomDraw:
        """Values of the randomised quantities of this scene."""
        return RandomDraw(self.randomise, self.seed)

    @cached_property
    def heights(self) -> NDArray[np.float32]:
        """The shape on the solver's grid, mm (POINTS, POINTS)."""
        return self.shape.map(POINTS, SPACING)

    @cached_property
    def window(self) -> int:
        """Points a side of the solver's window around every contact, on the gel of any sensor."""
        poses = self.path.pose(self.times(FPS))
        return window(
            torch.from_numpy(self.heights), SPACING, torch.from_numpy(poses).float(), _DOMES
        )


def simulated_rate(sensor: str) -> float:
    """Simulated frames per second: the sensor's own, at most `FPS`."""
    return min(spec(sensor).fps, FPS)


def draw_scene(
    seed: int,
    shape: Shape,
    motion: str,
    *,
    force: tuple[float, float] = (0.5, 8.0),
    seconds: float = 0.6,
    randomise: Choice = "unit",
    reach: Literal["error", "clip"] = "error",
) -> Scene:
    """Draws a touch: place, depth, tilt, distance, speed and friction.

    Args:
        seed: Seed of the touch.
        shape: The object.
        motion: One of `motions.MOTIONS`.
        force: Range of the largest normal force, N; converted to a depth on a flat gel like the
            Mini's. The forces of the shape between 0.05 and 1.5 mm limit the range.
        seconds: Mean duration of one action, s.
        randomise: Differences between units and scenes, see `randomise.draw.randomised_rows`.
        reach: ``error`` to raise for a shape outside the range, ``clip`` to press as near to the
            range as possible.

    Raises:
        ConfigError: An unknown motion, an invalid range, or a range beyond the shape.
    """
    if motion not in MOTIONS:
        raise ConfigError(unknown("motion", motion, MOTIONS))
    if not 0 < force[0] <= force[1] or seconds <= 0:
        raise ConfigError(f"scene: force={force} N and seconds={seconds} must be greater than 0")
    # The order of the draws below defines the touch of a seed: another order gives other touches.
    rng = np.random.default_rng([seed, 0x51])
    row = RandomDraw(randomise, seed)
    tilt = rng.normal(0, row["tilt"], 2)
    shape = _finished(shape, row)
    heights = shape.map(POINTS, SPACING)
    speeds = Speeds(
        depth=_depth(shape.name, heights, tilt, row["softness"], force, rng.uniform(), reach),
        slide=rng.uniform(1.5, 4.0),
        turn=rng.uniform(0.15, 0.6),
        seconds=seconds * rng.uniform(0.8, 1.2),
        rest=0.15,
    )
    angle = rng.uniform(-np.pi, np.pi)
    start = (*rng.uniform(-2, 2, 2), angle, *tilt)
    path = _cleared(MOTIONS[motion](start, speeds, rng), heights)
    path = replace(path, sway=_sway(row, speeds.depth))
    grip = float(rng.uniform())
    return Scene(seed=seed, shape=shape, path=path, motion=motion, grip=grip, randomise=randomise)


def _finished(shape: Shape, row: RandomDraw) -> Shape:
    """A shape with the wear, the printed lines and the grain of a scene, if it has any."""
    if radius := row["worn"]:
        shape = replace(shape, height=worn(shape.height, radius))
    if deviation := row["warp"]:
        seed = int(row.rng("warp").integers(1 << 31))
        height, across = warped(shape.height, deviation, seed), shape.radius + 2 * deviation
        shape = replace(shape, height=height, radius=across, round=False)
    # Only what was printed has lines: indenters, and no everyday surface.
    if (distance := row["print_lines"]) and shape.index is not None:
        angle = row.rng("print_lines").uniform(0, 180)
        shape = printed(shape, distance, _PRINT * distance, angle)
    for name, finer in (("roughness", 1.0), ("grain", _FINER)):
        if deviation := row[name]:
            seed = int(row.rng(name).integers(1 << 31))
            shape = replace(
                shape, height=covered(shape.height, rough(deviation, seed), finer), round=False
            )
    return shape


def _depth(
    name: str,
    heights: NDArray[np.float32],
    tilt: NDArray[np.float64],
    softness: float,
    force: tuple[float, float],
    place: float,
    reach: str,
) -> float:
    """Depth (mm) of a press, for a force at a place (0 to 1) of a range (N), on a log scale."""
    poses = torch.zeros(1, len(_DEPTHS), 6)
    poses[0, :, 3] = torch.tensor(_DEPTHS)
    poses[0, :, 4:] = torch.from_numpy(tilt)
    moments = contacts(
        torch.from_numpy(heights)[None], SPACING, [Gel()], poses, [FPS], name, [softness]
    )
    forces: list[float] = []
    for moment in moments:
        forces.append(float(moment.force[0, 2]))
        if forces[0] <= force[1] <= forces[-1]:  # deeper ones are beyond the range
            break
    low, high = max(force[0], forces[0]), min(force[1], forces[-1])
    if low > high and reach == "clip":
        low = high = float(np.clip(low, forces[0], forces[-1]))
    if low > high:
        raise ConfigError(
            f"scene: force={force} N, but {name} presses with {forces[0]:.2g} to "
            f"{forces[-1]:.3g} N at {_DEPTHS[0]} to {_DEPTHS[-1]} mm; give a range that meets these"
        )
    # In logarithms: interpolation is then exact where force grows as a power of the depth.
    wanted = low * (high / low) ** place
    depths = np.log(_DEPTHS[: len(forces)])
    return float(np.exp(np.interp(np.log(wanted), np.log(forces), depths)))


def _cleared(path: Path, height: NDArray[np.float32]) -> Path:
    """The path with an end clear of any gel, at any place on its dome."""
    line = (np.arange(POINTS) - (POINTS - 1) / 2) * SPACING
    x, y = np.meshgrid(line, line)

    def lowest(pose: NDArray[np.float64], bend: float) -> float:
        cos, sin = np.cos(pose[2]), np.sin(pose[2])
        across, down = pose[0] + cos * x - sin * y, pose[1] + sin * x + cos * y
        tilted = height + pose[4] * x + pose[5] * y
        return float((tilted + bend * (across**2 + down**2)).min())

    bends = [0.0 if dome is None else 1 / (2 * dome) for dome in _DOMES]
    first, last = path.poses[0], path.poses[-1]
    touching = min(lowest(last, bend) - lowest(first, bend) for bend in bends)
    poses = path.poses.copy()
    ends = (poses[:, 3] <= -CLEAR) & (np.arange(len(poses)) > len(poses) // 2)
    poses[ends, 3] = min(0.0, touching) - CLEAR
    return replace(path, poses=poses)


def _sway(row: RandomDraw, depth: float) -> Sway | None:
    """Deviation of a hand from the path, for a depth (mm)."""
    share, steep = row["sway"], row["force_follows_shear"]
    if not share and not steep:
        return None
    rng = row.rng("sway")
    heading = rng.uniform(0, 2 * np.pi)
    size = np.array(_SWAY) * share * (1, 1, 1, depth, 1, 1)
    return Sway(
        slope=steep * np.array([np.cos(heading), np.sin(heading)]),
        size=size * rng.uniform(0, 1, (_WAVES, 6)) / np.sqrt(_WAVES / 2),
        hertz=rng.uniform(*_HERTZ, _WAVES),
        phase=rng.uniform(0, 2 * np.pi, (_WAVES, 6)),
    )
