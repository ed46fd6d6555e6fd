"""Features of the gel's surface as inputs of a sensor's lighting model.

At the image's resolution: powers of the surface's normal. On a coarse grid: scattering of light in
the gel (slopes and bulges of the blurred dent) and its blocking (shadows). All features are 0
where nothing is pressed.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import cv2
import torch
import torch.nn.functional as F
from torch import Tensor

#: Exponents of nx and ny in the features at full resolution.
POWERS = ((1, 0), (0, 1), (2, 0), (1, 1), (0, 2), (3, 0), (2, 1), (1, 2), (0, 3))
#: Size of a cell of the coarse grid, and standard deviations of its blurs, mm. Light in a gel
#: scatters over several distances; the fit of a calibration weighs the three.
CELL = 0.25
BLURS = (0.3, 1.0, 2.0)
#: Distances at which a shadow searches for an obstacle to the light, mm; slope of the light's path;
#: and depth below a shadow's edge, mm, at which it is two thirds dark.
REACH = (0.5, 1.0, 1.5, 2.0, 3.0, 4.0)
LIGHT_SLOPE = 0.2
EDGE = 0.3


def exponents(degree: int) -> list[tuple[int, int]]:
    """Exponents of x and y of the polynomials of the place, in the order of `places`."""
    return [(i, j) for i in range(degree + 1) for j in range(degree + 1 - i)]


def places(height: int, width: int, degree: int) -> Tensor:
    """The polynomials x^i y^j of the place in an image, x and y from -1 to 1.

    Returns:
        float32 (P, H, W), in the order of `exponents`.
    """
    x = (2 * torch.arange(width) + 1) / width - 1
    y = (2 * torch.arange(height) + 1) / height - 1
    return torch.stack([y[:, None] ** j * x**i for i, j in exponents(degree)])


def normals(dent: Tensor, spacing: float, steepest: float = 1.0) -> tuple[Tensor, Tensor]:
    """The lateral parts of the surface's unit normal, by central differences.

    Args:
        dent: float32 (B, H, W), depth of the surface, mm into the gel.
        spacing: Width of a pixel, mm.
        steepest: Limit of the lateral length for steep slopes; 1 for unit normals. Lower for a
            sensor calibrated on gentle slopes only: its light is taken to saturate beyond.

    Returns:
        nx and ny, (B, H, W): positive where the dent grows deeper to the right, and downwards.
    """
    wide = F.pad(dent[:, None], (1, 1, 1, 1), mode="replicate")[:, 0]
    x = (wide[:, 1:-1, 2:] - wide[:, 1:-1, :-2]).mul_(0.5 / spacing)
    y = (wide[:, 2:, 1:-1] - wide[:, :-2, 1:-1]).mul_(0.5 / spacing)
    shorten = (x * x).addcmul_(y, y).mul_(steepest**-2).add_(1).rsqrt_()
    return x.mul_(shorten), y.mul_(shorten)


def fine(x: Tensor, y: Tensor) -> list[Tensor]:
    """The features of normals at full resolution, in the order of `POWERS`."""
    xx, xy, yy = x * x, x * y, y * y
    return [x, y, xx, xy, yy, xx * x, xx * y, yy * x, yy * y]


class Coarse:
    """The coarse features of dents of one size: three per blur, and a shadow per light."""

    def __init__(
        self,
        size: tuple[int, int],
        spacing: float,
        lights: Sequence[float],
        device: str | torch.device = "cpu",
    ) -> None:
        """Prepares the grid.

        Args:
            size: Height and width of the image.
            spacing: Width of a pixel, mm.
            lights: Direction of each light from the centre, rad, clockwise from the right.
            device: Device of the dents.
        """
        shrink = max(1, round(CELL / spacing))
        height, width = (math.ceil(n / shrink) for n in size)
        down, right = size[0] * spacing / height, size[1] * spacing / width
        self.size, self.full = (height, width), size
        self._rows = [_blur(height, blur / down).to(device) for blur in BLURS]
        self._columns = [_blur(width, blur / right).T.contiguous().to(device) for blur in BLURS]
        self._down = _difference(height, down).to(device)
        self._right = _difference(width, right).T.contiguous().to(device)
        self._taller = _enlarge(height, size[0]).to(device)
        self._wider = _enlarge(width, size[1]).T.contiguous().to(device)
        self._paths = [
            [(round(r * math.sin(a) / down), round(r * math.cos(a) / right), r) for r in REACH]
            for a in lights
        ]

    def __call__(self, dent: Tensor) -> Tensor:
        """The features of dents (B, H, W) in mm: (B, K, h, w)."""
        sharp = F.interpolate(dent[:, None], self.size, mode="area")[:, 0]
        maps = []
        before = sharp
        for rows, columns in zip(self._rows, self._columns, strict=True):
            blurred = rows @ sharp @ columns
            maps += [blurred @ self._right, self._down @ blurred, before - blurred]
            before = blurred
        return torch.stack(maps + [self._shadow(sharp, path) for path in self._paths], 1)

    def enlarge(self, field: Tensor) -> Tensor:
        """A field (..., h, w) of the grid, enlarged to the image's resolution (..., H, W)."""
        if field.device.type != "cpu" or field.requires_grad:
            return self._taller @ (field @ self._wider)
        out = field.new_empty(*field.shape[:-2], *self.full)
        for small, large in zip(field.flatten(0, -3), out.flatten(0, -3), strict=True):
            cv2.resize(small.numpy(), self.full[::-1], large.numpy())  # bilinear
        return out

    def _shadow(self, sharp: Tensor, path: list[tuple[int, int, float]]) -> Tensor:
        """Darkness of the surface in the shadow of a light, 0 to 1."""
        height, width = self.size
        margin = max(max(abs(y), abs(x)) for y, x, _ in path)
        wide = F.pad(sharp[:, None], (margin,) * 4, mode="replicate")[:, 0]
        dark = torch.zeros_like(sharp)
        for y, x, far in path:
            blocking = wide[:, margin + y :, margin + x :][:, :height, :width]
            dark = torch.maximum(dark, blocking - sharp - far * LIGHT_SLOPE)
        return 1 - torch.exp(-dark / EDGE)


def _blur(points: int, sigma: float) -> Tensor:
    """The matrix of a Gaussian blur; edges are repeated."""
    steps = torch.arange(-math.ceil(4 * sigma), math.ceil(4 * sigma) + 1)
    weights = torch.softmax(-0.5 * (steps / sigma) ** 2, 0)
    columns = (torch.arange(points)[:, None] + steps).clamp(0, points - 1)
    return torch.zeros(points, points).scatter_add_(1, columns, weights.expand(points, -1))


def _difference(points: int, spacing: float) -> Tensor:
    """The matrix of central differences; edges are repeated."""
    rows = torch.arange(points)
    matrix = torch.zeros(points, points)
    matrix[rows, (rows + 1).clamp(max=points - 1)] += 0.5 / spacing
    matrix[rows, (rows - 1).clamp(min=0)] -= 0.5 / spacing
    return matrix


def _enlarge(points: int, more: int) -> Tensor:
    """The matrix (more, points) of linear interpolation."""
    return F.interpolate(torch.eye(points)[None, None], (more, points), mode="bilinear")[0, 0]
