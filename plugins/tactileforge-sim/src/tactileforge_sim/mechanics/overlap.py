"""Placement of objects against gels: poses, motion, and overlap with the undeformed gel."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from tactileforge_depth.gel import Gel
from torch import Tensor

#: Sizes of windows, in points, whose doubles have quick Fourier transforms.
_WINDOWS = (16, 20, 24, 30, 32, 36, 40, 48, 50, 54, 60, 64, 72, 80, 90, 96, 108, 128, 160, 192, 256)
#: Margin (mm) of a window in height: the gel bulges around a contact, and ahead of an object that
#: drags it, and may touch there too.
_ROOM = 0.08


class Overlap:
    """Overlap of objects with undeformed gels, in the frames of the objects.

    Args:
        heights: float32 (B, n, n), mm of the objects above their lowest planes.
        spacing: Distance between the points of these maps, mm.
        gels: The gel of each touch.
        poses: float32 (B, T, 6), poses; depth counts from the first touch at the first of them.
            None counts depth from the apex of the gel.
    """

    def __init__(
        self, heights: Tensor, spacing: float, gels: Sequence[Gel], poses: Tensor | None
    ) -> None:
        n = heights.shape[-1]
        line = (torch.arange(n, device=heights.device) - (n - 1) / 2) * spacing
        self.y, self.x = torch.meshgrid(line, line, indexing="ij")
        self.heights, self.spacing = heights, spacing
        self.bend = torch.tensor(
            [0 if g.dome is None else 1 / (2 * g.dome) for g in gels], device=heights.device
        )
        self.first = torch.zeros(len(gels), device=heights.device)
        if poses is not None:
            self.first = self(poses[:, 0]).amax((1, 2)) - poses[:, 0, 3]

    def __call__(self, pose: Tensor) -> Tensor:
        """Overlap (B, n, n), mm, at poses (B, 6)."""
        return overlapping(self.x, self.y, self.heights, pose, self.depth(pose), self.bend)

    def depth(self, pose: Tensor) -> Tensor:
        """Depth of the lowest planes of the objects beyond the apex, mm (B,)."""
        return pose[:, 3] - self.first

    def motion(self, old: Tensor, new: Tensor) -> Tensor:
        """Motion (B, 2, n, n), mm, of the points of the objects, in their new frames."""
        before, now = (torch.stack(placed(self.x, self.y, pose), 1) for pose in (old, new))
        return rotated(now - before, -new[:, 2])

    def window(self, poses: Tensor) -> int:
        """Points a side of the smallest window around every contact."""
        near = torch.zeros_like(self.x, dtype=torch.bool)
        for i in range(poses.shape[1]):
            near |= (self(poses[:, i]) > -_ROOM).any(0)
        reach = torch.maximum(self.x.abs(), self.y.abs())[near]
        n = len(self.x)
        need = 2 * float(reach.max()) / self.spacing + 1 if len(reach) else 2.0
        return next((w for w in _WINDOWS if need <= w <= n and (n - w) % 2 == 0), n)

    def cropped(self, window: int) -> Overlap:
        """The same overlap, on the middle ``window`` points a side."""
        edge = (len(self.x) - window) // 2
        middle = slice(edge, edge + window)
        out = object.__new__(Overlap)
        out.x, out.y = self.x[middle, middle], self.y[middle, middle]
        out.heights, out.spacing = self.heights[:, middle, middle], self.spacing
        out.bend, out.first = self.bend, self.first
        return out


def overlapping(
    x: Tensor, y: Tensor, heights: Tensor, pose: Tensor, depth: Tensor, bend: Tensor
) -> Tensor:
    """Overlap (B, ...), mm, of objects at poses with gels domed by ``bend`` (1/mm)."""
    across, down = placed(x, y, pose)
    tilt_x, tilt_y = pose[:, 4:, None, None].unbind(1)
    rest = bend[:, None, None] * (across**2 + down**2)
    return depth[:, None, None] - heights - tilt_x * x - tilt_y * y - rest


def placed(x: Tensor, y: Tensor, pose: Tensor) -> tuple[Tensor, Tensor]:
    """Places in the image (mm) of points of objects."""
    left, top, angle = pose[:, :3, None, None].unbind(1)
    cos, sin = torch.cos(angle), torch.sin(angle)
    return left + cos * x - sin * y, top + sin * x + cos * y


def rotated(vectors: Tensor, angle: Tensor) -> Tensor:
    """Vectors (B, 2, ...) turned clockwise in the image."""
    cos, sin = (part[:, None, None] for part in (torch.cos(angle), torch.sin(angle)))
    x, y = vectors.unbind(1)
    return torch.stack([cos * x - sin * y, sin * x + cos * y], 1)
