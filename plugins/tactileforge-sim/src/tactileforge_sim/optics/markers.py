"""Markers: dark dots in the gel, moving with its surface."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import torch
import torch.nn.functional as F
from torch import Tensor

from tactileforge.contracts import MarkerPattern
from tactileforge.errors import ConfigError


@dataclass(frozen=True)
class Markers:
    """Discs printed on a gel.

    Attributes:
        places: float32 (M, 2), x and y at rest, mm from the centre of the image.
        radii: float32 (M,), mm.
        colour: R, G, B in grey levels.
        opacity: Share of the image's light that a marker blocks.
    """

    places: Tensor
    radii: Tensor
    colour: tuple[float, float, float] = (25.0, 25.0, 28.0)
    opacity: float = 0.9

    def to(self, device: str | torch.device) -> Markers:
        """The same markers on a device."""
        return replace(self, places=self.places.to(device), radii=self.radii.to(device))

    def paint(self, pictures: Tensor, motion: Tensor | None, spacing: float) -> None:
        """Paints the markers over images, in place.

        Args:
            pictures: float32 (B, 3, H, W), grey levels.
            motion: float32, displacement right and down, mm: (B, M, 2) of the markers, or
                (B, H, W, 2) of the surface at the pixels; None for no motion.
            spacing: Width of a pixel, mm.

        Raises:
            ConfigError: The shape of ``motion`` is neither.
        """
        batch, _, height, width = pictures.shape
        moved = self._moved(motion, height, width, spacing)
        middle = torch.tensor([width, height], device=pictures.device) / 2 - 0.5
        cover = coverage(moved / spacing + middle, self.radii / spacing, height, width)
        cover = (self.opacity * cover)[:, None].expand(batch, -1, -1, -1)
        colour = torch.tensor(self.colour, device=pictures.device)[:, None, None]
        pictures.lerp_(colour.expand_as(pictures), cover.expand_as(pictures))

    def _moved(self, motion: Tensor | None, height: int, width: int, spacing: float) -> Tensor:
        """Positions of the markers, (B, M, 2) or (1, M, 2), mm."""
        if motion is None:
            return self.places[None]
        if motion.shape[1:] == self.places.shape:
            return self.places + motion
        if motion.shape[1:] != (height, width, 2):
            raise ConfigError(
                f"motion is {tuple(motion.shape)}; give (B, {len(self.places)}, 2) at the markers,"
                f" or (B, {height}, {width}, 2) at the pixels"
            )
        half = torch.tensor([width, height], device=motion.device) * spacing / 2
        where = (self.places / half).expand(len(motion), 1, -1, -1)
        field = motion.permute(0, 3, 1, 2)
        there = F.grid_sample(field, where, padding_mode="border", align_corners=False)
        return self.places + there[:, :, 0].transpose(1, 2)


def coverage(centres: Tensor, radii: Tensor, height: int, width: int) -> Tensor:
    """Coverage of each pixel by discs with smooth edges.

    Args:
        centres: float32 (B, M, 2), x and y in pixels; (0, 0) is the middle of the first pixel.
        radii: float32 (M,), pixels.
        height: Height of the image, pixels.
        width: Width of the image, pixels.

    Returns:
        float32 (B, H, W), 0 to 1.
    """
    reach = math.ceil(float(radii.max()) + 1)
    steps = torch.arange(-reach, reach + 1, device=centres.device)
    stamp = torch.stack(torch.meshgrid(steps, steps, indexing="xy"), -1).flatten(0, 1)
    pixels = centres.round().long()[:, :, None] + stamp
    distance = torch.linalg.vector_norm(pixels - centres[:, :, None], dim=-1)
    cover = (radii[:, None] + 0.5 - distance).clamp_(0, 1)
    x, y = pixels.unbind(-1)
    inside = (x >= 0) & (x < width) & (y >= 0) & (y < height)
    at = torch.where(inside, y * width + x, height * width)
    out = centres.new_zeros(len(centres), height * width + 1)
    out.scatter_add_(1, at.flatten(1), cover.flatten(1))
    return out[:, :-1].view(-1, height, width).clamp_(max=1)


def print_markers(pattern: MarkerPattern, generator: torch.Generator) -> Markers:
    """The markers of one gel, with small variations of places and radii.

    Args:
        pattern: Marker pattern of the sensor's type.
        generator: Random generator of the variations.
    """
    x = (torch.arange(pattern.columns) - (pattern.columns - 1) / 2) * pattern.pitch[0]
    y = (torch.arange(pattern.rows) - (pattern.rows - 1) / 2) * pattern.pitch[1]
    places = torch.stack(torch.meshgrid(x, y, indexing="xy"), -1).flatten(0, 1)
    places = places + pattern.jitter * torch.randn(places.shape, generator=generator)
    spread = 1 + 0.06 * torch.randn(len(places), generator=generator).clamp(-2, 2)
    return Markers(places, pattern.radius * spread)
