"""Images and forces of touches on any number of sensors."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields, replace
from itertools import islice

import numpy as np
import torch
from numpy.typing import NDArray
from tactileforge_depth.gel import Gel

from tactileforge.errors import ConfigError
from tactileforge_sim.mechanics.sensor_gels import sensor_gel
from tactileforge_sim.mechanics.surface import DETAIL, GelSurface
from tactileforge_sim.mechanics.touch import ContactState, contacts
from tactileforge_sim.optics import sensor_instances
from tactileforge_sim.scene import POINTS, SPACING, Scene, simulated_rate
from tactileforge_sim.view import SensorView

#: Frames rendered per step.
_CHUNK = 8


@dataclass(frozen=True)
class SimFrames:
    """Some frames of one sensor in one scene, in order.

    Attributes:
        scene: Index of the scene in the argument of `play_scenes`.
        sensor: Index of the sensor in the argument of `play_scenes`.
        pictures: uint8 (K, H, W, 3), RGB.
        force: float32 (K, 3), force of the object on the gel, N.
        torque: float32 (K,), torque about the object's axis, N mm.
        surface: uint8 (K, h, w, 3), displacement of the gel's surface, see
            `displacement.encode_displacement`; None without ``surface=True``.
    """

    scene: int
    sensor: int
    pictures: NDArray[np.uint8]
    force: NDArray[np.float32]
    torque: NDArray[np.float32]
    surface: NDArray[np.uint8] | None


@torch.inference_mode()
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

    All sensors touch the same object on the same path. Contacts of one solver are solved in one
    batch, across scenes and sensors; each is bit-identical to the same contact solved alone.

    Args:
        scenes: The touches.
        sensors: Types of sensors, see `specs.published.SIMULATED`.
        size: Shorter side of the images, pixels.
        markers: Whether the gels have markers; None for their types' default.
        viscosity: Relaxation time of the gels, s; their forces then lead their images. A lower
            limit for scenes with a drawn relaxation time.
        surface: Whether to yield the displacement of the gels' surfaces.
        device_name: Torch device of the computation.

    Raises:
        ConfigError: An unknown sensor, a size below 8, or a shape too fine for the grid.
        contact.NotConverged: The solver failed; the message names the seed.
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
    """A gel in a scene, and the sensors sharing it: their gels and rates are equal."""

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
    """Plays touches on gels of one solver."""
    paths = [feel.scene.poses(feel.fps) for feel in group]
    frames = [len(path) for path in paths]
    # Shorter paths rest at their last poses, clear of the gel; their further moments are dropped.
    full = [np.concatenate([p, np.repeat(p[-1:], max(frames) - len(p), 0)]) for p in paths]
    poses = torch.from_numpy(np.stack(full)).float()
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
        scene = feel.scene
        fine = scene.shape.map(POINTS * DETAIL, SPACING / DETAIL)
        self.number = feel.number
        self.surface = GelSurface(torch.from_numpy(fine)[None].to(where), SPACING, feel.gel)
        drift = torch.from_numpy(scene.drift(feel.fps)).to(where)
        self.views = []
        for place, name in feel.seen.items():
            view = SensorView(
                name,
                scene.seed if scene.unit is None else scene.unit,
                show.size,
                randomise=scene.randomise,
                markers=show.markers,
                surface=show.surface,
                drift=drift if "drift" in scene.row.chosen else None,
                device_name=where,
            )
            self.views.append((place, view))

    def shots(self, first: int, part: ContactState) -> Iterator[SimFrames]:
        """Renders a batch of moments; ``first`` is the number of its first frame."""
        touched = bool(part.strain[:, 0].any())
        fields = self.surface.fields(part) if touched else None
        for place, view in self.views:
            pictures, displaced = view.pictures(first, self.surface, fields, part)
            force, torque = part.force.cpu().numpy(), part.torque.cpu().numpy()
            yield SimFrames(self.number, place, pictures, force, torque, displaced)


def _part(moments: Sequence[ContactState], row: int) -> ContactState:
    """One touch of a batch at several moments, as a batch of moments."""
    return ContactState(
        *(
            torch.stack([getattr(m, field.name)[row] for m in moments])
            for field in fields(ContactState)
        )
    )
