"""The border of a picture: a dark rounded frame around the gel, and a glowing lamp inside it."""

from __future__ import annotations

import torch
from torch import Tensor

from tactileforge_sim.optics.stray_light import between

#: Widths of the frame's sides, and radius and softness of its corners, least and largest; all
#: lengths here are shares of the image's shorter side. Sides of less than 0 are not in the picture.
_SIDE, _CORNER, _SOFT = (-0.04, 0.02), (0.04, 0.16), (0.006, 0.02)
#: Distance from the frame to the brightest part of a glow, and its width; depth and width of the
#: shade beyond it, and reach of a glow along the frame.
_NEAR, _WIDE, _SHADE, _FAR = (0.0, 0.04), (0.01, 0.05), (0.0, 0.35), (0.06, 0.2)
_ALONG = 0.1


def border(
    size: tuple[int, int],
    dark: float,
    glow: float,
    shape: torch.Generator,
    lamp: torch.Generator,
) -> tuple[Tensor, Tensor]:
    """A frame and the glow of a lamp.

    Args:
        size: Height and width of the image, pixels.
        dark: Darkness of the frame, as a share of the light; 0 for no frame.
        glow: Light of the lamp, grey levels; 0 for none.
        shape: Generator of the frame's sides and corners.
        lamp: Generator of the lamp's side, colour and width.

    Returns:
        Share of the light that passes, float32 (H, W), and the glow, grey levels (3, H, W).
    """
    height, width = size
    short = min(size)
    y, x = torch.meshgrid(torch.arange(height) / short, torch.arange(width) / short, indexing="ij")
    sides = [between(_SIDE, place) for place in torch.rand(4, generator=shape).tolist()]
    corner, soft = torch.rand(2, generator=shape).tolist()
    # distances inwards from the left, right, top and bottom of the frame
    into = (
        x - sides[0],
        width / short - sides[1] - x,
        y - sides[2],
        height / short - sides[3] - y,
    )
    bend = between(_CORNER, corner)
    across, down = torch.minimum(*into[:2]), torch.minimum(*into[2:])
    inside = bend - torch.hypot((bend - across).clamp(min=0), (bend - down).clamp(min=0))
    inside = torch.where((across > bend) | (down > bend), torch.minimum(across, down), inside)
    passing = torch.sigmoid(inside / between(_SOFT, soft))
    which, near, wide, shade, far, hue = torch.rand(6, generator=lamp).tolist()
    side = into[int(2 * which)].clamp(min=0)  # lamps are at the left and the right
    seen = 1 - dark * (1 - passing)
    if not glow:
        return seen, torch.zeros(3, height, width)
    # the band follows the frame and its corners, near its side only
    band = torch.exp(-0.5 * ((inside - between(_NEAR, near)) / between(_WIDE, wide)) ** 2)
    band = band * torch.exp(-side / _ALONG)
    colour = torch.tensor([0.1 + 0.2 * hue, 1.0, 0.3 + 0.4 * (1 - hue)])
    shaded = 1 - between(_SHADE, shade) * torch.exp(-side / between(_FAR, far))
    return seen * shaded, glow * seen * band * colour[:, None, None]
