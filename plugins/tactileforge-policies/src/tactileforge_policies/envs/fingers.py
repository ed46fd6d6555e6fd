"""Pictures of the two fingers of a gripper around one object."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from tactileforge_depth.gel import Gel
from tactileforge_sim.geometry.indenter_geometry import Shape
from tactileforge_sim.mechanics.sensor_gels import sensor_gel
from tactileforge_sim.mechanics.surface import DETAIL, GelSurface
from tactileforge_sim.mechanics.touch import ContactState
from tactileforge_sim.optics import sensor_instances
from tactileforge_sim.randomise.draw import Choice
from tactileforge_sim.view import SensorView

from tactileforge_policies.envs.grip import POINTS, SPACING

#: Names of the fingers.
FINGERS = ("left", "right")
#: Number of frames with different noise; then it repeats.
_FILM = 1 << 20


class Fingers:
    """Two units of one type of sensor, face to face.

    Args:
        sensor: Type of the sensor, see `specs.published.SIMULATED`.
        unit: Seed of the pair; a different unit is a different pair of gel pads and cameras.
        size: Height and width of the frames, pixels; the whole gel is resized to this square.
        randomise: Differences between units, see `randomise.draw.randomised_rows`.

    Raises:
        ConfigError: The sensor is unknown, or the size too small.
    """

    def __init__(self, sensor: str, unit: int, size: int, randomise: Choice = "unit") -> None:
        device = sensor_gel(sensor)
        self.size, self.friction = size, device.friction
        self.gel: Gel = sensor_instances.instance_gel(device.gel, sensor, 2 * unit, randomise)
        self.views = {
            name: SensorView(sensor, 2 * unit + side, size, randomise=randomise)
            for side, name in enumerate(FINGERS)
        }
        self._surfaces: dict[str, GelSurface] = {}
        self._first = self._number = 0

    def meet(self, shape: Shape, film: int) -> None:
        """Prepares for a new object.

        Args:
            shape: Face of the object towards the left gel; the right one meets the mirror image.
            film: Seed of the noise of the frames.
        """
        fine = torch.from_numpy(shape.map(POINTS * DETAIL, SPACING / DETAIL))[None]
        faces = dict(zip(FINGERS, (fine, fine.flip(-1)), strict=True))
        self._surfaces = {name: GelSurface(face, SPACING, self.gel) for name, face in faces.items()}
        self._first, self._number = film % _FILM, 0
        for view in self.views.values():
            view.restart()

    def pictures(self, moment: ContactState) -> dict[str, NDArray[np.uint8]]:
        """Draws both fingers for a contact of the left one: uint8 (size, size, 3), by finger."""
        self._number += 1
        moments = dict(zip(FINGERS, (moment, mirrored(moment)), strict=True))
        out = {}
        for name, part in moments.items():
            surface = self._surfaces[name]
            number = self._first + self._number
            frames, _ = self.views[name].pictures(number, surface, surface.fields(part), part)
            out[name] = _square(frames[0], self.size)
        return out


def mirrored(moment: ContactState) -> ContactState:
    """Contact of the other finger: the mirror image along x."""
    pose = moment.pose * moment.pose.new_tensor([-1, 1, -1, 1, -1, 1])
    strain = moment.strain.flip(-1) * moment.strain.new_tensor([1, -1, 1])[:, None, None]
    return replace(
        moment,
        pose=pose,
        pressure=moment.pressure.flip(-1),
        shear=_flipped(moment.shear),
        force=moment.force * moment.force.new_tensor([-1, 1, 1]),
        torque=-moment.torque,
        strain=strain,
    )


def _flipped(shear: torch.Tensor) -> torch.Tensor:
    return shear.flip(-1) * shear.new_tensor([-1, 1])[:, None, None]


def _square(frame: NDArray[np.uint8], size: int) -> NDArray[np.uint8]:
    """Resizes a frame to a square, as data modules do for encoders."""
    return np.asarray(cv2.resize(frame, (size, size), interpolation=cv2.INTER_AREA), np.uint8)
