"""Baselines: features of frames without training on touch, in place of an encoder."""

from __future__ import annotations

import math
from collections.abc import Callable

import torch
from torch import Tensor
from torch.nn import functional as F

from tactileforge.encoders import STATISTICS_SIZE, statistics_of
from tactileforge_bench.fit.baseline import Baseline
from tactileforge_bench.fit.imagenet import ImageNetFeatures
from tactileforge_bench.fit.pixels import PixelFeatures

_SIZE = STATISTICS_SIZE
# Nine directions without sign, as Dalal and Triggs find best; 8 x 8 cells of a picture.
_CELL, _BINS = 16, 9
# As many numbers as the baseline `pixels` has of a frame, to compare the two.
_SMALL = 16


class Flat(Baseline):
    """Base of fixed features: two frames less their background, to one vector.

    Attributes:
        width: Size of the vector, which is the only token.
        projected: The same.
        flat: True: it has no patches.
    """

    flat = True

    def __init__(self) -> None:
        super().__init__(_SIZE, _SIZE)
        # the width is that of what it reads of a blank clip
        blank = torch.zeros(1, 2, 3, _SIZE, _SIZE, dtype=torch.uint8)
        self.width = self.projected = self(blank, blank[:, 0], torch.zeros(1))[1].shape[1]

    def forward(self, frames: Tensor, background: Tensor, sensor: Tensor) -> tuple[Tensor, Tensor]:
        """(B, 1, width) and (B, width) of uint8 frames (B, 2, 3, H, W)."""
        features = self.read(self.pixels(frames, background))
        return features[:, None], features

    def read(self, x: Tensor) -> Tensor:
        """(B, width) of two frames (B, 2, 3, H, W), less their background."""
        raise NotImplementedError


class FrameStatistics(Flat):
    """Statistics of the last frame: moments, quantiles, gradients and rings of the spectrum."""

    def read(self, x: Tensor) -> Tensor:
        """(B, width): moments, quantiles, gradients and spectrum of the last frame."""
        return statistics_of(x[:, -1])


class Motion(Flat):
    """Energy of the change from the background, and between the frames, of each channel."""

    def read(self, x: Tensor) -> Tensor:
        """(B, width): energies of the changes."""
        still = x[:, -1] - x[:, -1].median(dim=3, keepdim=True).values
        change = x[:, -1] - x[:, 0]
        parts = [part.flatten(2) for part in (x[:, -1], still, change)]
        return torch.cat([s for p in parts for s in (p.abs().mean(2), p.square().mean(2))], 1)


class Hog(Flat):
    """Histograms of oriented gradients of the last frame (Dalal and Triggs, CVPR 2005).

    Cells of 16 pixels at 128 x 128, nine directions without sign, each histogram normed together
    with those of its 2 x 2 blocks' cells.
    """

    def read(self, x: Tensor) -> Tensor:
        """(B, width): normalised histograms of the last frame."""
        # edges are repeated: a border of zeros would be an edge of its own
        grey = F.pad(x[:, -1].mean(1, keepdim=True), (1, 1, 1, 1), mode="replicate")
        dx = grey[:, :, 1:-1, 2:] - grey[:, :, 1:-1, :-2]
        dy = grey[:, :, 2:, 1:-1] - grey[:, :, :-2, 1:-1]
        angle = torch.atan2(dy, dx).remainder(math.pi) / math.pi * _BINS
        low = angle.floor()
        # a gradient counts for both directions beside it, so features change smoothly as it turns
        part, low = angle - low, low.long() % _BINS
        size = (dx**2 + dy**2).sqrt()
        bins = torch.zeros(len(x), _BINS, *size.shape[2:], device=x.device)
        bins.scatter_add_(1, low, size * (1 - part))
        bins.scatter_add_(1, (low + 1) % _BINS, size * part)
        cells = F.avg_pool2d(bins, _CELL)
        # a cell lies in up to four blocks, and is normed with each: contrast differs over the gel
        blocks = F.unfold(cells, 2)
        return F.normalize(blocks, dim=1).flatten(1)


class BackgroundOnly(Flat):
    """The frame without contact at 16 x 16: features from before any contact.

    A task that it solves has a shortcut, e.g. if all recordings of an object are of one hour.
    """

    def forward(self, frames: Tensor, background: Tensor, sensor: Tensor) -> tuple[Tensor, Tensor]:
        """(B, 1, width) and (B, width) of uint8 backgrounds (B, 3, H, W)."""
        features = F.adaptive_avg_pool2d(background.float() / 255, _SMALL).flatten(1)
        return features[:, None], features


class Chance(Flat):
    """No features: a probe predicts the mean, or the first class."""

    def read(self, x: Tensor) -> Tensor:
        """(B, 1) zeros."""
        return torch.zeros(len(x), 1, device=x.device)


#: Baseline by the word that names it, and its name in print.
BASELINES: dict[str, tuple[Callable[[], Baseline], str]] = {
    "pixels": (PixelFeatures, "16 x 16 pixels of the difference"),
    "statistics": (FrameStatistics, "picture statistics"),
    "motion": (Motion, "motion energy"),
    "hog": (Hog, "HOG"),
    "imagenet": (ImageNetFeatures, "EfficientNet-Lite0, ImageNet"),
    "background": (BackgroundOnly, "background alone"),
    "chance": (Chance, "chance"),
}
