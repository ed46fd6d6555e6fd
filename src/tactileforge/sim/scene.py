"""A touch from a seed, and its pictures and forces on any number of sensors."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import islice

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from tactileforge.errors import ConfigError, unknown
from tactileforge.sim import contact
from tactileforge.sim.devices import FPS, device
from tactileforge.sim.gel import Gel, kernel
from tactileforge.sim.motions import MOTIONS, Path, Speeds
from tactileforge.sim.optics import Optics
from tactileforge.sim.shapes import Shape
from tactileforge.sim.surface import DETAIL, Surface
from tactileforge.sim.touch import Contact, contacts
from tactileforge.sim.units import draw as draw_unit
from tactileforge.specs import spec

#: The solver's grid: points a side, mm between them. It is 14.4 mm wide.
POINTS, SPACING = 72, 0.2
#: Frames that are rendered at a time.
_CHUNK = 8
#: Depths (mm) at which the force of a shape is sounded.
_DEPTHS = (0.05, 0.1, 0.2, 0.35, 0.55, 0.8, 1.1, 1.5)


@dataclass(frozen=True, kw_only=True)
class Scene:
    """One touch, apart from the sensor.

    Attributes:
        seed: Draws the units of the sensors and their noise, and names the touch in errors.
        shape: What touches.
        path: How it moves.
        motion: Name of the motion.
        grip: From slippery (0) to sticky (1).
        unit: Draws the units of the sensors instead of the seed, if given.
    """

    seed: int
    shape: Shape
    path: Path
    motion: str
    grip: float = 0.5
    unit: int | None = None

    def times(self, fps: float) -> NDArray[np.float64]:
        """When frames are taken, s."""
        return np.arange(int(self.path.seconds * fps) + 1) / fps


def frame_rate(sensor: str) -> float:
    """Frames per second that are simulated."""
    return min(spec(sensor).fps, FPS)


def draw(
    seed: int,
    shape: Shape,
    motion: str,
    *,
    force: tuple[float, float] = (0.5, 8.0),
    seconds: float = 0.6,
) -> Scene:
    """Draws a touch: where, how deep, how tilted, how far, how fast, and how sticky.

    Args:
        seed: Same seed, same touch.
        shape: What touches.
        motion: One of `motions.MOTIONS`.
        force: Range of the largest normal force, N; the depth that gives it is looked up, and kept
            between 0.05 and 1.5 mm.
        seconds: Mean duration of one action.

    Raises:
        ConfigError: An unknown motion, or a range that is none.
    """
    if motion not in MOTIONS:
        raise ConfigError(unknown("motion", motion, MOTIONS))
    if not 0 < force[0] <= force[1] or seconds <= 0:
        raise ConfigError(f"scene: force={force} N and seconds={seconds} must be greater than 0")
    rng = np.random.default_rng([seed, 0x51])
    tilt = rng.normal(0, 0.015, 2)
    speeds = Speeds(
        depth=_depth(shape, tilt, float(np.exp(rng.uniform(*np.log(force))))),
        slide=rng.uniform(1.5, 4.0),
        turn=rng.uniform(0.15, 0.6),
        seconds=seconds * rng.uniform(0.8, 1.2),
        rest=0.15,
    )
    angle = rng.uniform(-np.pi, np.pi)
    start = (*rng.uniform(-2, 2, 2), angle, *tilt)
    path = MOTIONS[motion](start, speeds, rng)
    return Scene(seed=seed, shape=shape, path=path, motion=motion, grip=float(rng.uniform()))


def _depth(shape: Shape, tilt: NDArray[np.float64], force: float) -> float:
    """Depth (mm) at which a shape presses with a force (N) on a flat gel like the Mini's."""
    line = (np.arange(POINTS) - (POINTS - 1) / 2) * SPACING
    height = shape.map(POINTS, SPACING) + tilt[0] * line + tilt[1] * line[:, None]
    overlap = torch.tensor(_DEPTHS)[:, None, None] - torch.from_numpy(height - height.min()).float()
    pressure = contact.press(kernel(Gel(), POINTS, SPACING), overlap)
    forces = pressure.sum((1, 2)) * SPACING**2
    return float(np.exp(np.interp(np.log(force), forces.log(), np.log(_DEPTHS))))


@dataclass(frozen=True)
class Shots:
    """Some frames of one sensor, in order.

    Attributes:
        sensor: Place of the sensor in the list that `play` was given.
        pictures: uint8 (K, H, W, 3), RGB.
        force: float32 (K, 3), N.
        torque: float32 (K,), N mm.
    """

    sensor: int
    pictures: NDArray[np.uint8]
    force: NDArray[np.float32]
    torque: NDArray[np.float32]


def play(
    scene: Scene,
    sensors: Sequence[str],
    size: int = 240,
    *,
    markers: bool | None = None,
    viscosity: float = 0.0,
    device_name: str = "cpu",
) -> Iterator[Shots]:
    """Pictures and forces of a touch on several sensors at once, a few frames at a time.

    All sensors feel the same object on the same path; the contact of all is solved in one batch.

    Args:
        scene: The touch.
        sensors: Types of sensors, see `devices.DEVICES`.
        size: Rows or columns of the pictures, whichever are fewer.
        markers: Whether the gels have markers; None as their types have.
        viscosity: Relaxation time of the gels, s; their forces then lead their pictures.
        device_name: Torch device that computes.

    Raises:
        ConfigError: An unknown sensor, a size that is none, or a shape that is finer than the grid.
        contact.NotConverged: The message names the seed.
    """
    if size < 8:
        raise ConfigError(f"size is {size} pixels; give 8 or more")
    views = [_View(scene, i, name, size, markers, device_name) for i, name in enumerate(sensors)]
    shape, fine = (
        torch.from_numpy(scene.shape.map(POINTS * n, SPACING / n)).to(device_name)
        for n in (1, DETAIL)
    )
    # Sensors whose gels and frame rates are the same feel the same.
    felt: dict[tuple[Gel, float], list[_View]] = {}
    for name, view in zip(sensors, views, strict=True):
        gel = replace(device(name).touched(scene.grip), viscosity=viscosity)
        felt.setdefault((gel, frame_rate(name)), []).append(view)
    layers = {(gel.thickness, gel.poisson) for gel, _ in felt}
    for layer in sorted(layers):
        group = {k: v for k, v in felt.items() if (k[0].thickness, k[0].poisson) == layer}
        surface = Surface(shape[None], fine[None], SPACING, next(iter(group))[0])
        yield from _play(scene, shape, surface, group)


def _play(
    scene: Scene, shape: Tensor, surface: Surface, group: Mapping[tuple[Gel, float], list[_View]]
) -> Iterator[Shots]:
    """Plays a touch on gels that one solver serves."""
    rates = [fps for _, fps in group]
    poses, frames = _aligned([scene.path.pose(scene.times(fps)) for fps in rates])
    moments = contacts(
        shape.expand(len(group), -1, -1),
        SPACING,
        [gel for gel, _ in group],
        poses.to(shape.device),
        rates,
        f"touch of seed {scene.seed}",
    )
    first = 0
    while chunk := list(islice(moments, _CHUNK)):
        for row, views in enumerate(group.values()):
            count = min(len(chunk), frames[row] - first)
            if count > 0:
                part = _part(chunk[:count], row)
                fields = surface.fields(part)
                for view in views:
                    yield view.shots(first, surface, fields, part)
        first += len(chunk)


class _View:
    """What one sensor sees of a scene."""

    def __init__(
        self, scene: Scene, number: int, sensor: str, size: int, markers: bool | None, where: str
    ) -> None:
        known = spec(sensor)
        scale = size / min(known.height, known.width)
        height, width = round(known.height * scale), round(known.width * scale)
        seed = scene.seed if scene.unit is None else scene.unit
        unit = draw_unit(sensor, seed, (height, width), markers)
        self.number = number
        self.optics = Optics(unit, where)
        line_x, line_y = (
            (torch.arange(count, device=where) - (count - 1) / 2) * unit.spacing
            for count in (width, height)
        )
        self.places = torch.stack(torch.meshgrid(line_x, line_y, indexing="xy"), -1)

    def shots(
        self, first: int, surface: Surface, fields: tuple[Tensor, Tensor], part: Contact
    ) -> Shots:
        """Renders a batch of moments, the first of which has a number."""
        count = len(part.pose)
        touched = part.force[:, 2] > 0
        dent = self.places.new_zeros(count, *self.places.shape[:2])
        if bool(touched.any()):
            there = fields[0][touched], fields[1][touched]
            dent[touched] = surface.picture(there, part.pose[touched], self.places)
        motion = None
        if self.optics.markers is not None:
            places = self.optics.markers.places.expand(count, -1, -1)
            motion = surface.lateral(part, places)
        pictures = self.optics.render(dent, motion, first)
        return Shots(
            self.number,
            pictures.permute(0, 2, 3, 1).contiguous().cpu().numpy(),
            part.force.cpu().numpy(),
            part.torque.cpu().numpy(),
        )


def _aligned(poses: Sequence[NDArray[np.float64]]) -> tuple[Tensor, list[int]]:
    """Paths of different length as one tensor (B, T, 6): the shorter ones stand still at the end.

    Returns:
        The poses, and the number of frames of each path.
    """
    frames = [len(p) for p in poses]
    longest = max(frames)
    full = [np.concatenate([p, np.repeat(p[-1:], longest - len(p), 0)]) for p in poses]
    return torch.from_numpy(np.stack(full)).float(), frames


def _part(moments: Sequence[Contact], row: int) -> Contact:
    """One touch of a batch at several moments, as a batch of moments."""
    names = ("pose", "pressure", "shear", "force", "torque", "strain")
    return Contact(*(torch.stack([getattr(m, name)[row] for m in moments]) for name in names))
