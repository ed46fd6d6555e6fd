"""The baseline ``imagenet``: features of a network of photographs, not of touch."""

from __future__ import annotations

import torch
from torch import Tensor

from tactileforge.encoders import DIFFERENCE_GAIN, EfficientNetLite, difference_picture, on_grid
from tactileforge_bench.fit.baseline import Baseline

_SIZE, _PATCH = 128, 16


class ImageNetFeatures(Baseline):
    """EfficientNet-Lite0's maps of each frame less its background, as patch tokens.

    What a model has to be better than: it sees the same two frames. A token has the maps at an
    eighth, averaged, a sixteenth, and a thirty-second of the size at its place.

    Attributes:
        width: Size of a token, 472.
        projected: Size of the vector of a frame, 1280; of a clip it is their mean.
    """

    def __init__(self) -> None:
        super().__init__(_SIZE, _PATCH)
        self.tower = EfficientNetLite(image_size=_SIZE)
        self.tube, self.grid = 1, (self.frames, *self.grid[1:])
        # of each frame; in the state, by which features are kept for the next run
        self.register_buffer("gain", torch.full((self.frames, 1, 1, 1), DIFFERENCE_GAIN))
        self.gain: Tensor
        self.projected = self.tower.width
        self.width = sum(self.tower.channels)

    def forward(self, frames: Tensor, background: Tensor, sensor: Tensor) -> tuple[Tensor, Tensor]:
        """(B, 128, width) and (B, projected) of uint8 frames (B, 2, 3, H, W)."""
        pictures = difference_picture(frames, background[:, None], self.gain)
        maps = self.tower.maps(pictures.flatten(0, 1))
        tokens = on_grid(maps, self.grid[1:]).view(len(frames), -1, self.width)
        return tokens, self.tower.vector(maps).view(*frames.shape[:2], -1).mean(1)
