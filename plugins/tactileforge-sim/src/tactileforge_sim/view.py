"""Pictures of a gel by one unit of a sensor."""

from __future__ import annotations

import math
from dataclasses import replace

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn import functional as F

from tactileforge.data import encode_displacement, grid_shape
from tactileforge.specs import pixel_spacing, spec
from tactileforge_sim.mechanics.surface import Fields, GelSurface
from tactileforge_sim.mechanics.touch import ContactState
from tactileforge_sim.optics import sensor_instances
from tactileforge_sim.optics.camera import FULL, Codec
from tactileforge_sim.optics.render import Optics
from tactileforge_sim.randomise.draw import Choice

#: Largest pixel of a drawn image, mm. Coarser images are drawn finer and shrunk: edges are sharper
#: than their pixels.
_FINEST = 0.13


class SensorView:
    """View of touches by one unit of a sensor.

    Args:
        sensor: Type of the sensor, see `specs.published.SIMULATED`.
        unit: Seed of the unit.
        size: Shorter side of the images, pixels.
        randomise: Differences between units, see `randomise.draw.randomised_rows`.
        markers: Whether the gel has markers; None for its type's default.
        surface: Whether to return the displacement of the gel's surface.
        drift: float32 (T, 3), change of the light from frame to frame, grey levels; None for none.
        device_name: Torch device of the computation.
    """

    def __init__(
        self,
        sensor: str,
        unit: int,
        size: int,
        *,
        randomise: Choice = "unit",
        markers: bool | None = None,
        surface: bool = False,
        drift: Tensor | None = None,
        device_name: str = "cpu",
    ) -> None:
        known = spec(sensor)
        full = min(known.height, known.width)
        shown = [round(side * size / full) for side in (known.height, known.width)]
        coarse = pixel_spacing(sensor, shown[0])
        shrink = math.ceil(coarse / _FINEST)
        height, width = (side * shrink for side in shown)
        drawn = sensor_instances.draw_instance(sensor, unit, (height, width), markers, randomise)
        # A pixel of a smaller image is the mean of many of the sensor's: its noise is less.
        drawn = replace(drawn, noise=drawn.noise * min(1.0, size / FULL))
        self.optics = Optics(drawn, device_name, shrink)
        self.shrink = FULL / size
        self.restart()
        self.drift = drift
        self.places = drawn.camera.places(height, width, drawn.spacing, device_name)
        self.cells = grid_shape(height, width) if surface else None
        none = self.places.new_zeros(0, 2)
        dots, image = self.optics.markers, self.places.permute(2, 0, 1)
        self.markers = none if dots is None else dots.places
        self.centres = (
            none if self.cells is None else F.adaptive_avg_pool2d(image, self.cells).flatten(1).T
        )

    def restart(self) -> None:
        """Begins a new film: its images are coded without those before."""
        self.codec = Codec(self.optics.unit.camera, self.shrink)

    def pictures(
        self, first: int, surface: GelSurface, fields: Fields | None, part: ContactState
    ) -> tuple[NDArray[np.uint8], NDArray[np.uint8] | None]:
        """Renders a batch of moments.

        Args:
            first: Number of the first frame, the seed of its noise.
            surface: Surface of the gel.
            fields: Fields of these moments, from `GelSurface.fields`; None for untouched gels.
            part: The moments.

        Returns:
            uint8 (K, H, W, 3), and the displacement of the surface, uint8 (K, h, w, 3), or None.
        """
        # From the strain, not the force: on lifting, a viscous gel stays dented without a force.
        touched = (part.strain[:, 0].amax((1, 2)) > 0)[:, None, None]
        if fields is None:
            dent = self.places.new_zeros(len(part.pose), *self.places.shape[:2])
        else:
            dent = surface.picture(fields, part, self.places)
            dent = dent if bool(touched.all()) else torch.where(touched, dent, 0.0)
        drift = None if self.drift is None else self.drift[first : first + len(dent)]
        # Lateral displacement of markers (K, M, 2) and cells (K, C, 2), mm, by one transform.
        points = torch.cat([self.markers, self.centres])
        rest = points.expand(len(part.pose), -1, -1)
        moves = fields is not None and len(points) > 0
        lateral = surface.lateral(part, rest) if moves else torch.zeros_like(rest)
        at_markers, at_cells = lateral[:, : len(self.markers)], lateral[:, len(self.markers) :]
        motion, unit = None, self.optics.unit
        if self.optics.markers is not None:
            # Markers are drawn in the distorted image: they move as its camera sees them move.
            there = self.markers + at_markers
            motion = unit.camera.seen(there, *self.optics.size, unit.spacing) - self.markers
        pictures = self.optics.render(dent, motion, first, drift)
        moved = None
        if self.cells is not None:
            deep = F.adaptive_avg_pool2d(dent[:, None], self.cells)
            across = torch.where(touched, at_cells, 0.0).mT.reshape(len(dent), 2, *self.cells)
            image = torch.cat([across, deep], 1).permute(0, 2, 3, 1)
            moved = encode_displacement(image.cpu().numpy())
        planes = pictures.cpu().numpy()
        shown = np.empty((len(planes), *planes.shape[2:], 3), np.uint8)
        for colours, picture in zip(planes, shown, strict=True):
            cv2.merge(list(colours), picture)
        return self.codec(shown), moved
