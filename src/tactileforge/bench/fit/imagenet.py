"""The baseline ``imagenet``: features of photographs, of a model that never saw touch."""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.nn import functional as F

from tactileforge.encoders.efficientnet_lite import EfficientNetLite
from tactileforge.encoders.preprocess import ANYTOUCH2, GAIN, Preprocess, difference_picture

_SIZE, _PATCH = 128, 16


class ImageNetFeatures(nn.Module):
    """EfficientNet-Lite0's maps of the last frame less its background, as patch tokens.

    What `objectives.distill` teaches, so a row that a distilled encoder is compared with. A token
    has the maps at an eighth, averaged, a sixteenth, and a thirty-second of the size at its place.

    Attributes:
        frames: 2, of which the last is read.
        width: Size of a token, 472.
        projected: Size of the vector of the picture, 1280.
    """

    def __init__(self) -> None:
        super().__init__()
        side = _SIZE // _PATCH
        self.frames, self.tube, self.patch, self.prefix = 2, 2, _PATCH, 0
        self.image_size = (_SIZE, _SIZE)
        self.grid = (1, side, side)
        self.sensors: dict[str, int] = {}
        self.pixels = Preprocess.of(self.image_size, ANYTOUCH2)
        self.tower = EfficientNetLite(image_size=_SIZE)
        # in the state, by which features are kept for the next run
        self.register_buffer("gain", torch.tensor(GAIN))
        self.gain: Tensor
        self.projected = self.tower.width
        self.width = sum(one.shape[1] for one in self.tower.maps(torch.zeros(1, 3, 32, 32)))

    def forward(self, frames: Tensor, background: Tensor, sensor: Tensor) -> tuple[Tensor, Tensor]:
        """(B, 64, width) and (B, projected) of uint8 frames (B, 2, 3, H, W)."""
        maps = self.tower.maps(difference_picture(frames[:, -1], background, self.gain))
        placed = [
            F.adaptive_avg_pool2d(x, self.grid[1:])
            if x.shape[2] > self.grid[1]
            else F.interpolate(x, self.grid[1:])
            for x in maps
        ]
        vector: Tensor = self.tower.top(maps[-1]).mean((2, 3))
        return torch.cat(placed, 1).flatten(2).mT, vector
