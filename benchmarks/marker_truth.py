"""Simulated touches of gels with printed markers, and the true places of these."""

from __future__ import annotations

from unittest import mock

import numpy as np
import torch
from numpy.typing import NDArray
from tactileforge_sim.config import SimConfig
from tactileforge_sim.optics.markers import Markers
from tactileforge_sim.play import play_scenes
from torch import Tensor


def simulated(
    sensor: str, seed: int, size: int = 240
) -> tuple[NDArray[np.uint8], NDArray[np.float64]]:
    """One touch of a gel with markers; the first frame is without contact.

    Args:
        sensor: Type of the sensor.
        seed: Seed of the touch, and of the unit.
        size: Shorter side of the frames, pixels.

    Returns:
        Frames, uint8 (T, H, W, 3), and places of all markers of the gel, also outside of the
        picture, (T, N, 2), pixels.
    """
    shares: list[NDArray[np.float64]] = []
    paint = Markers.paint

    def spy(self: Markers, pictures: Tensor, motion: Tensor | None, spacing: float) -> None:
        height, width = pictures.shape[-2:]
        middle = torch.tensor([width, height]) / 2
        at = (self._moved(motion, height, width, spacing) / spacing + middle) / height
        shares.extend(at.expand(len(pictures), -1, -1).double().numpy())
        paint(self, pictures, motion, spacing)

    config = SimConfig(
        sensors=(sensor,),
        indenters="all",
        motions="manipulation",
        size=size,
        seconds=0.8,
        force=(1.0, 8.0),
        markers=True,
        viscosity=0.0,
        lag=0.0,
        seed=seed,
    )
    with mock.patch.object(Markers, "paint", spy):
        shots = list(play_scenes(config.scene(0), (sensor,), size, markers=True))
    frames = np.concatenate([shot.pictures for shot in shots])
    # where the unit draws its background, markers are painted once more, before the touch
    return frames, np.stack(shares[-len(frames) :]) * frames.shape[1] - 0.5
