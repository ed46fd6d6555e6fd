"""Normals and depth of a gel's surface from its picture: the inverse of `render`.

Grey levels are a polynomial of the normal, so a few Gauss-Newton steps per pixel find the most
probable normal; a prior keeps the surface flat where the picture does not change. The slopes are
integrated by Poisson's equation. Scattered light and shadows depend on the whole surface: they are
computed from the estimated depth and subtracted from the picture, and the remainder is inverted
again.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from tactileforge.errors import ConfigError
from tactileforge_depth.features import POWERS, Coarse, fine, places
from tactileforge_depth.lighting import DEGREE, OpticalCalibration

#: Gauss-Newton steps of a pixel, and rounds of subtracting the scattered light.
_STEPS, _ROUNDS = 3, 3
#: Step of a round towards the newly estimated scattered light, 0 to 1.
_SHARE = 0.7
#: Standard deviation of the calibration's error on real pictures, grey levels (a PSNR of 30 dB);
#: and of normals.
_ERROR, _SLOPE = 6.0, 0.3
#: Upper limit of a normal's lateral length, as a share of the steepest, whose slope is infinite.
_MOST = 0.95
#: Width of the image's border, as a share of its height and width.
_BORDER = 0.04


@dataclass(frozen=True)
class Surface:
    """An estimate of a gel's surface.

    Attributes:
        slope: float32 (B, 2, H, W), growth of the depth to the right and downwards.
        depth: float32 (B, H, W), mm into the gel; 0 on average along the border of the image.
    """

    slope: Tensor
    depth: Tensor

    @property
    def normal(self) -> Tensor:
        """Unit normals, pointing out of the gel, float32 (B, 3, H, W): x right, y down, z out."""
        out = torch.cat([self.slope, torch.ones_like(self.slope[:, :1])], 1)
        normal: Tensor = out / out.norm(dim=1, keepdim=True)
        return normal


class SurfaceReader:
    """Reads the surface of a gel from its pictures.

    Args:
        calibration: Response of the sensor's image to the surface.
        size: Height and width of the pictures.
        spacing: Width of a pixel, mm.

    Example:
        >>> import torch
        >>> from tactileforge_depth.lighting import load_optics
        >>> reader = SurfaceReader(load_optics("digit"), (60, 80), 0.25)
        >>> still = torch.full((3, 60, 80), 100.0)
        >>> float(reader.read(still[None], still).depth.abs().max())
        0.0
    """

    def __init__(
        self, calibration: OpticalCalibration, size: tuple[int, int], spacing: float
    ) -> None:
        self.calibration, self.size, self.spacing = calibration, size, spacing
        weights = torch.einsum("kpc,phw->kchw", calibration.fine, places(*size, DEGREE))
        self._fine = weights.flatten(2)
        self._coarse = Coarse(size, spacing, calibration.lights)
        ground = places(*self._coarse.size, DEGREE)
        self._smooth = torch.einsum("kpc,phw->kchw", calibration.coarse, ground)
        self._limits = calibration.limits[:, None, None]
        self._poisson = Poisson(size, spacing)

    def read(self, pictures: Tensor, background: Tensor) -> Surface:
        """The surface in each picture.

        Args:
            pictures: (B, 3, H, W), RGB grey levels.
            background: (3, H, W), the picture without contact.

        Raises:
            ConfigError: The size of the pictures or the background differs from the reader's.
        """
        if tuple(pictures.shape[1:]) != (3, *self.size) or background.shape != pictures.shape[1:]:
            raise ConfigError(
                f"pictures are {tuple(pictures.shape)} and the background "
                f"{tuple(background.shape)}, but (B, 3, {self.size[0]}, {self.size[1]}) and one "
                "of these are read"
            )
        change = pictures.float() - background
        rows, columns = (max(1, round(_BORDER * n)) for n in self.size)
        inner = torch.zeros_like(change[:1, 0])
        inner[:, rows:-rows, columns:-columns] = 1
        rim = 1 - inner
        scattered = torch.zeros_like(change)
        for _ in range(_ROUNDS):
            slope = self._slopes(change - scattered)
            depth = self._poisson(slope)
            # Slopes leave a constant open; it is chosen to put the border at rest.
            depth = depth - (depth * rim).sum((1, 2), keepdim=True) / rim.sum()
            # Change of the picture by the coarse features of that surface, (B, 3, H, W).
            coarse = self._coarse(depth).clamp(-self._limits, self._limits)
            small = torch.einsum("bkhw,kchw->bchw", coarse, self._smooth)
            scattered = torch.lerp(scattered, self._coarse.enlarge(small), _SHARE)
        return Surface(slope, depth)

    def _slopes(self, change: Tensor) -> Tensor:
        """The most probable slopes (B, 2, H, W) for a change of grey levels (B, 3, H, W)."""
        steepest = self.calibration.steepest
        seen = change.flatten(2)
        x = y = torch.zeros_like(seen[:, 0])
        # Ratio of the variances of error and normal: the weight of a Gaussian prior on normals.
        prior = (_ERROR / min(_SLOPE, steepest)) ** 2
        for _ in range(_STEPS):
            rest = seen - _weighted(fine(x, y), self._fine)
            right, down = (_weighted(part, self._fine) for part in _fine_slopes(x, y))
            xx, xy, yy = (right**2).sum(1) + prior, (right * down).sum(1), (down**2).sum(1) + prior
            a, b = (right * rest).sum(1) - prior * x, (down * rest).sum(1) - prior * y
            scale = 1 / (xx * yy - xy * xy)
            x, y = x + scale * (yy * a - xy * b), y + scale * (xx * b - xy * a)
            shorten = (_MOST * steepest / torch.hypot(x, y).clamp(min=1e-9)).clamp(max=1)
            x, y = x * shorten, y * shorten
        normal = torch.stack([x, y], 1)
        slope = normal / (1 - normal.square().sum(1, keepdim=True) / steepest**2).sqrt()
        return slope.reshape(len(change), 2, *self.size)


def _weighted(features: list[Tensor], weights: Tensor) -> Tensor:
    """Grey levels (B, 3, n) of features (B, n) each, by weights (K, 3, n)."""
    out = features[0][:, None] * weights[0]
    for feature, weight in zip(features[1:], weights[1:], strict=True):
        out.addcmul_(feature[:, None], weight)
    return out


def _fine_slopes(x: Tensor, y: Tensor) -> tuple[list[Tensor], list[Tensor]]:
    """Derivatives of `features.fine` by x and by y."""
    powers = [(torch.ones_like(part), part, part * part) for part in (x, y)]
    none = torch.zeros_like(x)

    def term(i: int, j: int, factor: int) -> Tensor:
        return factor * powers[0][i] * powers[1][j] if factor else none

    by_x = [term(max(i - 1, 0), j, i) for i, j in POWERS]
    by_y = [term(i, max(j - 1, 0), j) for i, j in POWERS]
    return by_x, by_y


class Poisson:
    """Integrates slopes into a surface by least squares.

    No slope is assumed beyond the border (Neumann), so cosines diagonalise Poisson's equation.

    Args:
        size: Height and width.
        spacing: Width of a pixel, mm.
    """

    def __init__(self, size: tuple[int, int], spacing: float) -> None:
        self.spacing = spacing
        self._rows, self._columns = (_cosines(n) for n in size)
        tall, wide = (2 - 2 * torch.cos(math.pi * torch.arange(n) / n) for n in size)
        curvature = tall[:, None] + wide
        # The constant has no curvature: its coefficient is set to 0, without a division by 0.
        curvature[0, 0] = 1.0
        self._inverse = 1 / curvature
        self._inverse[0, 0] = 0.0

    def __call__(self, slope: Tensor) -> Tensor:
        """The surface, (B, H, W), of mean 0, of slopes (B, 2, H, W) to the right and downwards."""
        # Between two pixels the surface rises by the mean of their slopes.
        right = self.spacing * (slope[:, 0, :, 1:] + slope[:, 0, :, :-1]) / 2
        down = self.spacing * (slope[:, 1, 1:] + slope[:, 1, :-1]) / 2
        source = torch.zeros_like(slope[:, 0])
        source[:, :, 1:] += right
        source[:, :, :-1] -= right
        source[:, 1:] += down
        source[:, :-1] -= down
        waves = self._rows @ source @ self._columns.T
        out: Tensor = self._rows.T @ (waves * self._inverse) @ self._columns
        return out


def _cosines(count: int) -> Tensor:
    """Orthonormal cosine transform (DCT-II), float32 (count, count)."""
    place, wave = torch.arange(count).double() + 0.5, torch.arange(count).double()[:, None]
    table = torch.cos(math.pi / count * place * wave) * math.sqrt(2 / count)
    table[0] /= math.sqrt(2)
    return table.float()
