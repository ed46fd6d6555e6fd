"""Stray light of lamps at the border of a gel: cones across the image, and hot spots."""

from __future__ import annotations

import math
from collections.abc import Sequence

import torch
from torch import Tensor

#: Place of a lamp, as a share of the way from the image's middle to its border.
_OUT = 1.35
#: Half of a cone's angle and the softness of its border, rad, least and largest.
_HALF, _SOFT = (0.35, 0.8), (0.03, 0.15)
#: Distance (shares of the image's shorter side) at which a cone's light has fallen to a half, and
#: radius of a hot spot.
_FALL, _SPOT = 0.7, (0.1, 0.22)


def stray_light(
    size: tuple[int, int],
    lights: Sequence[float],
    cones: float,
    hot_spots: float,
    chance: torch.Generator,
) -> Tensor:
    """Stray light of one lamp of each colour, grey levels, float32 (3, H, W).

    Args:
        size: Height and width of the image, pixels.
        lights: Directions of the R, G and B lamps, rad, clockwise from the right.
        cones: Light of a cone at its lamp, grey levels.
        hot_spots: Light of a hot spot in its middle, grey levels.
        chance: Generator of angles, borders and strengths.
    """
    height, width = size
    short = min(size)
    y, x = torch.meshgrid(
        (torch.arange(height) - (height - 1) / 2) / short,
        (torch.arange(width) - (width - 1) / 2) / short,
        indexing="ij",
    )
    out = torch.zeros(3, height, width)
    for channel, light in enumerate(lights):
        lean, half, soft, spot, bright, glare = torch.rand(6, generator=chance).tolist()
        right, down = math.cos(light), math.sin(light)
        reach = _OUT / max(abs(right) * short / width, abs(down) * short / height) / 2
        across, along = x - reach * right, y - reach * down
        far = torch.hypot(across, along)
        beam = light + math.pi + 0.6 * (lean - 0.5)
        off = torch.atan2(
            along * math.cos(beam) - across * math.sin(beam),
            across * math.cos(beam) + along * math.sin(beam),
        ).abs()
        border = _between(_HALF, half) - off
        cone = torch.sigmoid(border / _between(_SOFT, soft)) / (1 + far / _FALL)
        disc = torch.exp(-0.5 * (far / _between(_SPOT, spot)) ** 2)
        out[channel] += cones * (0.5 + 0.5 * bright) * cone
        out += hot_spots * glare * disc * (0.4 + 0.6 * (torch.arange(3) == channel))[:, None, None]
    return out


def _between(limits: tuple[float, float], place: float) -> float:
    return limits[0] + (limits[1] - limits[0]) * place
