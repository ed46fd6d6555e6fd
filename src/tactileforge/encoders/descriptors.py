"""Descriptors of pictures that nobody has to learn: an image tower without weights."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import ClassVar

import torch
from torch import Tensor, nn
from torch.nn import functional as F

__all__ = ["Descriptors", "frame_statistics", "gradient_histograms", "moments", "rings"]

_SIZE, _CELL, _BINS = 128, 16, 9
#: Rows and columns of means in a cell, and of the small picture.
_MEANS, _SMALL = 4, 8
_QUANTILES = (0.01, 0.05, 0.25, 0.5, 0.75, 0.95, 0.99)
#: Edges of the rings of the spectrum, in cycles per pixel.
_RINGS = (0.0, 0.015, 0.03, 0.06, 0.12, 0.2, 0.3, 0.5)
#: Changes this small are noise; logarithms start here.
_NOISE = 0.01


class Descriptors(nn.Module):
    """A teacher of `heads.distill`: what classical descriptors say of a touch, at 128 x 128 pixels.

    Of each cell of 16 x 16 pixels the means of 4 x 4 places, the histogram of oriented gradients
    and the roughness of each channel; of the whole picture its 8 x 8 means, `moments`, `rings` and
    the histograms of 4 x 4 cells. Amplitudes are kept: gradients and roughness are logarithms, not
    normed.
    Source: histograms as targets as in MaskFeat (Wei et al., CVPR 2022).

    Attributes:
        width: Size of the vector.
    """

    modality = "image"
    frozen: ClassVar[bool] = True

    def __init__(self) -> None:
        super().__init__()
        self.width = self(torch.zeros(1, 3, 32, 32)).shape[1]

    def forward(self, images: Tensor) -> Tensor:
        """See `whole`."""
        return self.whole(images)

    def whole(self, images: Tensor) -> Tensor:
        """Of the whole picture: (B, 3, h, w) from 0 to 255, about 127.5, to (B, `width`)."""
        x = _picture(images)
        small = F.adaptive_avg_pool2d(x, _SMALL)
        histograms = F.avg_pool2d(_log(gradient_histograms(x)), 2)
        # moments of half the size take a quarter of the time
        parts = small, moments(F.avg_pool2d(x, 2)), rings(x), histograms
        return torch.cat([part.flatten(1) for part in parts], 1)

    def maps(self, images: Tensor) -> list[Tensor]:
        """Of each cell: (B, 3, h, w) to (B, 48, 8, 8), (B, 9, 8, 8) and (B, 3, 8, 8)."""
        x = _picture(images)
        means = F.avg_pool2d(x, _CELL // _MEANS)
        rest = x - F.interpolate(means, scale_factor=_CELL // _MEANS)
        rough = F.avg_pool2d(rest.square(), _CELL).sqrt()
        return [F.pixel_unshuffle(means, _MEANS), _log(gradient_histograms(x)), _log(rough)]


def _picture(images: Tensor) -> Tensor:
    x = (images.float() - 127.5) / 255
    if x.shape[-2:] != (_SIZE, _SIZE):
        x = F.interpolate(x, (_SIZE, _SIZE), mode="bilinear", antialias=True)
    return x


def _log(x: Tensor) -> Tensor:
    return (x / _NOISE).log1p()


def gradient_histograms(x: Tensor) -> Tensor:
    """Mean gradient of each direction in cells of 16 pixels: (B, C, h, w) to (B, 9, h/16, w/16).

    Nine directions without sign, of the mean of the channels (Dalal and Triggs, CVPR 2005).
    """
    grey = F.pad(x.mean(1, keepdim=True), (1, 1, 1, 1), mode="replicate")
    dx = grey[:, :, 1:-1, 2:] - grey[:, :, 1:-1, :-2]
    dy = grey[:, :, 2:, 1:-1] - grey[:, :, :-2, 1:-1]
    angle = torch.atan2(dy, dx).remainder(math.pi) / math.pi * _BINS
    low = angle.floor()
    part, low = angle - low, low.long() % _BINS
    size = (dx**2 + dy**2).sqrt()
    bins = torch.zeros(len(x), _BINS, *size.shape[2:], device=x.device)
    bins.scatter_add_(1, low, size * (1 - part))
    bins.scatter_add_(1, (low + 1) % _BINS, size * part)
    return F.avg_pool2d(bins, _CELL)


def frame_statistics(x: Tensor) -> Tensor:
    """`moments`, and `rings` of the spectrum: (B, 3, h, w) to (B, 69)."""
    return torch.cat([moments(x), rings(x).flatten(1)], 1)


def moments(x: Tensor) -> Tensor:
    """Moments, gradients and quantiles of each channel, correlations: (B, 3, h, w) to (B, 48)."""
    flat = x.flatten(2)
    mean, spread = flat.mean(2), flat.std(2)
    unit = (flat - mean[..., None]) / spread[..., None].clamp(min=1e-6)
    edges = torch.tensor(_QUANTILES, device=x.device)
    quantiles = flat.quantile(edges, dim=2).permute(1, 2, 0)
    steps = [x.diff(dim=dim).flatten(2) for dim in (2, 3)]
    slopes = [part for step in steps for part in (step.abs().mean(2), step.std(2))]
    each = [mean, spread, unit.pow(3).mean(2), unit.pow(4).mean(2), *slopes]
    between = (unit[:, [0, 0, 1]] * unit[:, [1, 2, 2]]).mean(2)
    return torch.cat([*each, quantiles.flatten(1), between], 1)


def rings(x: Tensor) -> Tensor:
    """Logarithm of the power in rings of the spectrum, (B, C, 7) of (B, C, H, W)."""
    power = torch.fft.fft2(x, norm="ortho").abs().square()
    across, down = (torch.fft.fftfreq(n, device=x.device) for n in (x.shape[3], x.shape[2]))
    radius = (across[None] ** 2 + down[:, None] ** 2).sqrt()
    inside = [(radius > low) & (radius <= high) for low, high in pairwise(_RINGS)]
    return (
        torch.stack([(power * ring).sum((2, 3)) / ring.sum() for ring in inside], 2).add(1e-6).log()
    )
