"""The baseline ``pixels``: raw pixels as features."""

from __future__ import annotations

import torch
from torch import Tensor
from torch.nn import functional as F

from tactileforge.encoders import sincos_position_embedding
from tactileforge_bench.fit.baseline import Baseline

_SIZE, _PATCH, _SMALL = 64, 8, 16


class PixelFeatures(Baseline):
    """Two frames less their background: patches with their positions, and a small image.

    It has no weights. Tokens are the patches of both frames, to which fixed positions are added;
    what stands for the class token are both frames at 16 x 16.

    Attributes:
        flat: True: a closed-form probe reads the small pictures alone.
        width: Size of a token.
        projected: Size of the small picture.
    """

    flat = True

    def __init__(self) -> None:
        super().__init__(_SIZE, _PATCH)
        self.width = 2 * 3 * _PATCH * _PATCH
        self.projected = 2 * 3 * _SMALL * _SMALL
        self.register_buffer(
            "position", sincos_position_embedding(self.grid, self.width), persistent=False
        )
        self.position: Tensor

    def forward(self, frames: Tensor, background: Tensor, sensor: Tensor) -> tuple[Tensor, Tensor]:
        """(B, 64, width) and (B, projected) of uint8 frames (B, 2, 3, H, W)."""
        x = self.pixels(frames, background).flatten(1, 2)
        # both frames of a place in one token, as tubes of the encoders have them
        patches = F.unfold(x, _PATCH, stride=_PATCH).transpose(1, 2)
        small = F.adaptive_avg_pool2d(x, _SMALL).flatten(1)
        return torch.add(patches, self.position), small
