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
            `displacement.encode_displacement`; None where it was not asked for.
    """

    scene: int
    sensor: int
    pictures: NDArray[np.uint8]
    force: NDArray[np.float32]
    torque: NDArray[np.float32]
    surface: NDArray[np.uint8] | None


def play_scenes(
    scenes: Scene | Sequence[Scene],
    sensors: Sequence[str],
    size: int = 240,
    *,
    markers: bool | None = None,
    viscosity: float = 0.0,
    surface: bool = False,
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
        surface: Whether to say how the gels' surfaces are displaced.
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
        yield from _play(group, window, _Show(size, markers, surface), device_name)


@dataclass(frozen=True)
class _Show:
    """Outputs of a contact; see `play_scenes`."""

    size: int
    markers: bool | None
    surface: bool


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


def _play(group: Sequence[_Feel], window: int, show: _Show, where: str) -> Iterator[SimFrames]:
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
    films = [_Film(feel, show, where) for feel in group]
    first = 0
    while chunk := list(islice(moments, _CHUNK)):
        for row, film in enumerate(films):
            count = min(len(chunk), frames[row] - first)
            if count > 0:
                yield from film.shots(first, _part(chunk[:count], row))
        first += len(chunk)


class _Film:
    """Views of a scene by the sensors of one gel."""

    def __init__(self, feel: _Feel, show: _Show, where: str) -> None:
        fine = feel.scene.shape.map(POINTS * DETAIL, SPACING / DETAIL)
        self.number = feel.number
        self.surface = GelSurface(torch.from_numpy(fine)[None].to(where), SPACING, feel.gel)
        drift = torch.from_numpy(feel.scene.drift(feel.fps)).to(where)
        self.views = [
            _View(feel.scene, place, name, show, drift, where) for place, name in feel.seen.items()
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
        self, scene: Scene, place: int, sensor: str, show: _Show, drift: Tensor, where: str
    ) -> None:
        known = spec(sensor)
        full = min(known.height, known.width)
        size = show.size
        shown = [round(side * size / full) for side in (known.height, known.width)]
        seed = scene.seed if scene.unit is None else scene.unit
        coarse = sensor_instances.pixel_spacing(sensor, shown[0])
        shrink = math.ceil(coarse / _FINEST)
        height, width = (side * shrink for side in shown)
        unit = sensor_instances.draw_instance(
            sensor, seed, (height, width), show.markers, scene.randomise
        )
        # A pixel of an image that is smaller than the sensor's is a mean of many.
        unit = replace(unit, noise=unit.noise * min(1.0, size / FULL))
        self.place = place
        self.optics = Optics(unit, where, shrink)
        self.codec = Codec(unit.camera, FULL / size)
        self.drift = drift if "drift" in scene.row.chosen else None
        self.places = unit.camera.places(height, width, unit.spacing, where)
        self.cells = displacement.grid_shape(height, width) if show.surface else None
        none = self.places.new_zeros(0, 2)
        markers, image = self.optics.markers, self.places.permute(2, 0, 1)
        self.markers = none if markers is None else markers.places
        self.centres = (
            none if self.cells is None else F.adaptive_avg_pool2d(image, self.cells).flatten(1).T
        )

    def pictures(
        self, first: int, surface: GelSurface, fields: Fields, part: ContactState
    ) -> tuple[NDArray[np.uint8], NDArray[np.uint8] | None]:
        """Renders a batch of moments.

        Returns:
            uint8 (K, H, W, 3), and the displacement of the surface, uint8 (K, h, w, 3), or None.
        """
        touched = (part.force[:, 2] > 0)[:, None, None]
        dent = torch.where(touched, surface.picture(fields, part, self.places), 0.0)
        drift = None if self.drift is None else self.drift[first : first + len(dent)]
        at_markers, at_cells = self._lateral(surface, part)
        pictures = self.optics.render(dent, self._motion(at_markers), first, drift)
        moved = self._displacement(dent, torch.where(touched, at_cells, 0.0))
        return self.codec(pictures.permute(0, 2, 3, 1).contiguous().cpu().numpy()), moved

    def _lateral(self, surface: GelSurface, part: ContactState) -> tuple[Tensor, Tensor]:
        """Lateral displacement of markers (K, M, 2) and cells (K, C, 2), mm, by one transform."""
        points = torch.cat([self.markers, self.centres])
        rest = points.expand(len(part.pose), -1, -1)
        lateral = surface.lateral(part, rest) if len(points) else rest
        return lateral[:, : len(self.markers)], lateral[:, len(self.markers) :]

    def _motion(self, lateral: Tensor) -> Tensor | None:
        """Displacement of the markers in the image, mm, float32 (K, M, 2); None without markers."""
        if self.optics.markers is None:
            return None
        unit = self.optics.unit
        there = self.markers + lateral
        return unit.camera.seen(there, *self.optics.size, unit.spacing) - self.markers

    def _displacement(self, dent: Tensor, lateral: Tensor) -> NDArray[np.uint8] | None:
        """Image of the displacement, uint8 (K, h, w, 3); None where it was not asked for."""
        if self.cells is None:
            return None
        deep = F.adaptive_avg_pool2d(dent[:, None], self.cells)
        across = lateral.mT.reshape(len(dent), 2, *self.cells)
        moved = torch.cat([across, deep], 1).permute(0, 2, 3, 1)
        return displacement.encode_displacement(moved.cpu().numpy())


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
