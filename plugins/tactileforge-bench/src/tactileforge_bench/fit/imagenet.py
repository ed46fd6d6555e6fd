"""The baseline ``imagenet``: features of a network of photographs, not of touch."""

from __future__ import annotations

import torch
from torch import Tensor

from tactileforge.encoders import DIFFERENCE_GAIN, EfficientNetLite, difference_picture, on_grid
from tactileforge_bench.fit.baseline import Baseline

_SIZE, _PATCH = 128, 16


class ImageNetFeatures(Baseline):
    """EfficientNet-Lite0's maps of the last frame less its background, as patch tokens.

    The row to compare an encoder with that `objectives.distill` has taught. A token has the maps
    at an eighth, averaged, a sixteenth, and a thirty-second of the size at its place.

    Attributes:
        width: Size of a token, 472.
        projected: Size of the vector of the picture, 1280.
    """

    def __init__(self) -> None:
        super().__init__(_SIZE, _PATCH)
        self.tower = EfficientNetLite(image_size=_SIZE)
        # in the state, by which features are kept for the next run
        self.register_buffer("gain", torch.tensor(DIFFERENCE_GAIN))
        self.gain: Tensor
        self.projected = self.tower.width
        self.width = sum(self.tower.channels)

    def forward(self, frames: Tensor, background: Tensor, sensor: Tensor) -> tuple[Tensor, Tensor]:
        """(B, 64, width) and (B, projected) of uint8 frames (B, 2, 3, H, W)."""
        maps = self.tower.maps(difference_picture(frames[:, -1], background, self.gain))
        return on_grid(maps, self.grid[1:]), self.tower.vector(maps)
