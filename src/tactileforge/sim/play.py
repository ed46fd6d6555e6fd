"""Images and forces of touches on any number of sensors."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields, replace
from itertools import islice

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn import functional as F

from tactileforge.data.labels import displacement
from tactileforge.errors import ConfigError
from tactileforge.sensors.specs import spec
from tactileforge.sim.mechanics.gel import Gel
from tactileforge.sim.mechanics.sensor_gels import sensor_gel
from tactileforge.sim.mechanics.surface import DETAIL, Fields, GelSurface
from tactileforge.sim.mechanics.touch import ContactState, contacts
from tactileforge.sim.optics import sensor_instances
from tactileforge.sim.optics.camera import FULL, Codec
from tactileforge.sim.optics.render import Optics
from tactileforge.sim.scene import POINTS, SPACING, Scene, simulated_rate

#: Frames that are rendered at a time.
_CHUNK = 8
#: Images are drawn with no larger pixels (mm), and then shrunk: edges are sharper than pixels.
_FINEST = 0.13


@dataclass(frozen=True)
class SimFrames:
    """Some frames of one sensor in one scene, in order.

    Attributes:
        scene: Place of the scene in the list that `play_scenes` was given.
        sensor: Place of the sensor in the list that `play_scenes` was given.
        pictures: uint8 (K, H, W, 3), RGB.
        force: float32 (K, 3), N.
        torque: float32 (K,), N mm.
        surface: uint8 (K, h, w, 3), how the gel's surface is displaced, see
            `displacement.encode_displacement`.
    """

    scene: int
    sensor: int
    pictures: NDArray[np.uint8]
    force: NDArray[np.float32]
    torque: NDArray[np.float32]
    surface: NDArray[np.uint8]


def play_scenes(
    scenes: Scene | Sequence[Scene],
    sensors: Sequence[str],
    size: int = 240,
    *,
    markers: bool | None = None,
    viscosity: float = 0.0,
    device_name: str = "cpu",
) -> Iterator[SimFrames]:
    """Simulates touches on several sensors at once, a few frames at a time.

    All sensors feel the same object on the same path. Contacts of all scenes and sensors that one
    solver serves are solved in one batch; each is the same, to the bit, alone or beside others.

    Args:
        scenes: The touches.
        sensors: Types of sensors, see `sensor_gels.DEVICES`.
        size: Rows or columns of the images, whichever are fewer.
        markers: Whether the gels have markers; None as their types have.
        viscosity: Relaxation time of the gels, s; their forces then lead their images. Scenes
            that draw their own have at least this.
        device_name: Torch device that computes.

    Raises:
        ConfigError: An unknown sensor, a size that is none, or a shape that is finer than the grid.
        contact.NotConverged: The message names the seed.
    """
    if size < 8:
        raise ConfigError(f"size is {size} pixels; give 8 or more")
    many = [scenes] if isinstance(scenes, Scene) else list(scenes)
    groups: dict[tuple[float, float, int], list[_Feel]] = {}
    for number, scene in enumerate(many):
        for feel in _feels(number, scene, sensors, viscosity):
            layer = (feel.gel.thickness, feel.gel.poisson, scene.window)
            groups.setdefault(layer, []).append(feel)
    for (*_, window), group in sorted(groups.items(), key=lambda item: item[0]):
        yield from _play(group, window, size, markers, device_name)


@dataclass(frozen=True)
class _Feel:
    """A gel that feels a scene, and the sensors that see it: their gels and rates are the same."""

    number: int
    scene: Scene
    gel: Gel
    fps: float
    seen: dict[int, str]


def _feels(number: int, scene: Scene, sensors: Sequence[str], viscosity: float) -> Iterator[_Feel]:
    felt: dict[tuple[Gel, float], dict[int, str]] = {}
    slow = max(viscosity, scene.row["viscosity"])
    for place, name in enumerate(sensors):
        base = replace(sensor_gel(name).touched(scene.grip), viscosity=slow)
        seed = scene.seed if scene.unit is None else scene.unit
        gel = sensor_instances.instance_gel(base, name, seed, scene.randomise)
        felt.setdefault((gel, simulated_rate(name)), {})[place] = name
    for (gel, fps), seen in felt.items():
        yield _Feel(number, scene, gel, fps, seen)


def _play(
    group: Sequence[_Feel], window: int, size: int, markers: bool | None, where: str
) -> Iterator[SimFrames]:
    """Plays touches on gels that one solver serves."""
    poses, frames = _aligned([feel.scene.poses(feel.fps) for feel in group])
    heights = torch.from_numpy(np.stack([feel.scene.heights for feel in group]))
    moments = contacts(
        heights.to(where),
        SPACING,
        [feel.gel for feel in group],
        poses.to(where),
        [feel.fps for feel in group],
        f"touch of seed {', '.join(str(s) for s in sorted({f.scene.seed for f in group}))}",
        [feel.scene.row["softness"] for feel in group],
        window,
    )
    films = [_Film(feel, size, markers, where) for feel in group]
    first = 0
    while chunk := list(islice(moments, _CHUNK)):
        for row, film in enumerate(films):
            count = min(len(chunk), frames[row] - first)
            if count > 0:
                yield from film.shots(first, _part(chunk[:count], row))
        first += len(chunk)


class _Film:
    """Views of a scene by the sensors of one gel."""

    def __init__(self, feel: _Feel, size: int, markers: bool | None, where: str) -> None:
        fine = feel.scene.shape.map(POINTS * DETAIL, SPACING / DETAIL)
        self.number = feel.number
        self.surface = GelSurface(torch.from_numpy(fine)[None].to(where), SPACING, feel.gel)
        drift = torch.from_numpy(feel.scene.drift(feel.fps)).to(where)
        self.views = [
            _View(feel.scene, place, name, size, markers, drift, where)
            for place, name in feel.seen.items()
        ]

    def shots(self, first: int, part: ContactState) -> Iterator[SimFrames]:
        """Renders a batch of moments, the first of which has a number."""
        fields = self.surface.fields(part)
        for view in self.views:
            pictures, displaced = view.pictures(first, self.surface, fields, part)
            force, torque = part.force.cpu().numpy(), part.torque.cpu().numpy()
            yield SimFrames(self.number, view.place, pictures, force, torque, displaced)


class _View:
    """View of a scene by one sensor."""

    def __init__(
        self,
        scene: Scene,
        place: int,
        sensor: str,
        size: int,
        markers: bool | None,
        drift: Tensor,
        where: str,
    ) -> None:
        known = spec(sensor)
        full = min(known.height, known.width)
        shown = [round(side * size / full) for side in (known.height, known.width)]
        seed = scene.seed if scene.unit is None else scene.unit
        coarse = sensor_instances.pixel_spacing(sensor, shown[0])
        shrink = math.ceil(coarse / _FINEST)
        height, width = (side * shrink for side in shown)
        unit = sensor_instances.draw_instance(
            sensor, seed, (height, width), markers, scene.randomise
        )
        # A pixel of an image that is smaller than the sensor's is a mean of many.
        unit = replace(unit, noise=unit.noise * min(1.0, size / FULL))
        self.place = place
        self.optics = Optics(unit, where, shrink)
        self.codec = Codec(unit.camera, FULL / size)
        self.drift = drift if "drift" in scene.row.chosen else None
        self.places = unit.camera.places(height, width, unit.spacing, where)
        self.cells = displacement.grid_shape(height, width)
        self.centres = F.adaptive_avg_pool2d(self.places.permute(2, 0, 1), self.cells).flatten(1).T

    def pictures(
        self, first: int, surface: GelSurface, fields: Fields, part: ContactState
    ) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
        """Renders a batch of moments.

        Returns:
            uint8 (K, H, W, 3), and the displacement of the surface, uint8 (K, h, w, 3).
        """
        count = len(part.pose)
        touched = part.force[:, 2] > 0
        dent = surface.picture(fields, part, self.places)
        dent = torch.where(touched[:, None, None], dent, 0.0)
        drift = None if self.drift is None else self.drift[first : first + count]
        motion, lateral = self._motion(surface, part)
        pictures = self.optics.render(dent, motion, first, drift)
        deep = F.adaptive_avg_pool2d(dent[:, None], self.cells)
        across = torch.where(touched[:, None, None], lateral, 0.0).mT
        across = across.reshape(count, 2, *self.cells)
        moved = displacement.encode_displacement(
            torch.cat([across, deep], 1).permute(0, 2, 3, 1).cpu().numpy()
        )
        return self.codec(pictures.permute(0, 2, 3, 1).contiguous().cpu().numpy()), moved

    def _motion(self, surface: GelSurface, part: ContactState) -> tuple[Tensor | None, Tensor]:
        """Displacement of markers in the image, and of the surface at the cells; mm (K, M, 2)."""
        markers, unit = self.optics.markers, self.optics.unit
        seen = self.centres if markers is None else torch.cat([markers.places, self.centres])
        rest = seen.expand(len(part.pose), -1, -1)
        lateral = surface.lateral(part, rest)
        count = len(self.centres)
        if markers is None:
            return None, lateral
        rest, there = rest[:, :-count], (rest + lateral)[:, :-count]
        moved = unit.camera.seen(there, *self.optics.size, unit.spacing) - rest
        return moved, lateral[:, -count:]


def _aligned(poses: Sequence[NDArray[np.float64]]) -> tuple[Tensor, list[int]]:
    """Paths of different length as one tensor (B, T, 6): the shorter ones stand still at the end.

    Returns:
        The poses, and the number of frames of each path.
    """
    frames = [len(p) for p in poses]
    longest = max(frames)
    full = [np.concatenate([p, np.repeat(p[-1:], longest - len(p), 0)]) for p in poses]
    return torch.from_numpy(np.stack(full)).float(), frames


def _part(moments: Sequence[ContactState], row: int) -> ContactState:
    """One touch of a batch at several moments, as a batch of moments."""
    return ContactState(
        *(
            torch.stack([getattr(m, field.name)[row] for m in moments])
            for field in fields(ContactState)
        )
    )
