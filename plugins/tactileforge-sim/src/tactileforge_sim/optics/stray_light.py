"""Stray light of lamps at the border of a gel: cones across the image, and hot spots."""

from __future__ import annotations

import math
from collections.abc import Sequence

import torch
from torch import Tensor

#: Place of a lamp, as a share of the way from the image's middle to its border, and that of a lamp
#: with streaks.
_OUT, _BEHIND = 1.35, 1.8
#: Half of a cone's angle and the softness of its border, rad, least and largest.
_HALF, _SOFT = (0.35, 0.8), (0.03, 0.15)
#: Distance (shares of the image's shorter side) at which a cone's light has fallen to a half, and
#: radius of a hot spot.
_FALL, _SPOT = 0.7, (0.1, 0.22)
#: Half of the angle of a cone that ends in an arc, rad; its length, softness of the arc, and width
#: of its bright border, shares of the image's shorter side.
_BROAD, _REACH, _SHARP, _FOLD = (0.4, 1.0), (0.6, 1.2), (0.02, 0.12), 0.03
#: Number of waves of a cone's streaks, and their frequencies, 1/rad; depth of streaks and light of
#: the border for `streaks` of 1, over the light of the cone.
_LINES, _WAVES, _DEEP, _BRIGHT = 8, (10.0, 70.0), 0.25, 0.4
#: Light of the red, green and blue cones with streaks, over that of others: blue is near its lamp.
_POWERS = (0.5, 0.7, 1.8)


def stray_light(
    size: tuple[int, int],
    lights: Sequence[float],
    cones: float,
    hot_spots: float,
    chance: torch.Generator,
    streaks: float = 0.0,
    lines: torch.Generator | None = None,
) -> Tensor:
    """Stray light of one lamp of each colour, grey levels, float32 (3, H, W).

    Args:
        size: Height and width of the image, pixels.
        lights: Directions of the R, G and B lamps, rad, clockwise from the right.
        cones: Light of a cone at its lamp, grey levels.
        hot_spots: Light of a hot spot in its middle, grey levels.
        chance: Generator of angles, borders and strengths.
        streaks: Depth of streaks in the cones, and light of their borders, over that of the cones.
            With streaks, cones end in an arc.
        lines: Generator of the streaks, needed with them.
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
        reach = (
            (_BEHIND if streaks else _OUT)
            / max(abs(right) * short / width, abs(down) * short / height)
            / 2
        )
        across, along = x - reach * right, y - reach * down
        far = torch.hypot(across, along)
        beam = light + math.pi + 0.6 * (lean - 0.5)
        side = torch.atan2(
            along * math.cos(beam) - across * math.sin(beam),
            across * math.cos(beam) + along * math.sin(beam),
        )
        if lines is not None:
            cone = _streaked(between(_BROAD, half) - side.abs(), side, far, streaks, lines)
        else:
            cone = torch.sigmoid((between(_HALF, half) - side.abs()) / between(_SOFT, soft))
        cone /= 1 + far / _FALL
        disc = torch.exp(-0.5 * (far / between(_SPOT, spot)) ** 2)
        power = _POWERS[channel] if streaks else 1.0
        out[channel] += power * cones * (0.5 + 0.5 * bright) * cone
        out += hot_spots * glare * disc * (0.4 + 0.6 * (torch.arange(3) == channel))[:, None, None]
    return out


def _streaked(
    border: Tensor, side: Tensor, far: Tensor, streaks: float, chance: torch.Generator
) -> Tensor:
    """A cone with streaks and an arc with a bright border at its end, of light near 1 within.

    Args:
        border: Angle from the cone's border, rad, positive within it.
        side: Angle from the cone's axis, rad.
        far: Distance from the lamp, shares of the image's shorter side.
        streaks: Depth of the streaks, and light of the border.
        chance: Generator of their places.
    """
    reach, curl, soft = torch.rand(3, generator=chance).tolist()
    arc = between(_REACH, reach) * (1 + 0.5 * (curl - 0.5) * side) - far
    within = torch.minimum(border + 0.3 * (curl - 0.5) * far, arc)
    turns, phases, sizes = torch.rand(3, _LINES, generator=chance)
    often = _WAVES[0] + (_WAVES[1] - _WAVES[0]) * turns
    waves = often[:, None, None] * side + (2 * math.pi * phases)[:, None, None]
    lines = (sizes[:, None, None] * torch.sin(waves)).sum(0) / math.sqrt(_LINES / 4)
    fold = torch.exp(-0.5 * (within / _FOLD) ** 2)
    lit = torch.sigmoid(within / between(_SHARP, soft))
    out: Tensor = lit * (1 + _DEEP * streaks * lines).clamp(min=0) + _BRIGHT * streaks * fold
    return out


def between(limits: tuple[float, float], place: float) -> float:
    """A number between limits, at a place from 0 to 1."""
    return limits[0] + (limits[1] - limits[0]) * place
