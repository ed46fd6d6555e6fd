"""A small image tower for the paired camera image: trained from scratch, nothing to download."""

from __future__ import annotations

from typing import Literal

import torch
from torch import Tensor, nn
from torch.nn import functional as F

from tactileforge.encoders.positions import sincos_grid
from tactileforge.encoders.tactile_vit import CLIP_MEAN, CLIP_STD
from tactileforge.encoders.transformer import Transformer, init_weights, size_preset


class ImageViT(nn.Module):
    """Encodes camera images to one vector each, resizing and normalisation included.

    Args:
        size: Size of the model: ``tiny``, ``small`` or ``base``; see `TactileViT`.
        depth: Number of blocks; None takes the size's.
        image_size: Height and width of resized images, pixels.
        patch: Rows and columns of a patch, a divisor of ``image_size``.
        frozen: Whether its weights stay fixed in training.

    Example:
        >>> import torch
        >>> ImageViT(depth=1)(torch.zeros(2, 3, 48, 64, dtype=torch.uint8)).shape
        torch.Size([2, 192])
    """

    modality = "image"

    def __init__(
        self,
        size: Literal["tiny", "small", "base"] = "tiny",
        depth: int | None = 4,
        image_size: int = 96,
        patch: int = 16,
        frozen: bool = False,
    ) -> None:
        super().__init__()
        self.width, blocks, heads = size_preset(size)
        self.image_size, self.frozen = image_size, frozen
        rows = image_size // patch
        self.embed = nn.Conv2d(3, self.width, patch, patch)
        self.class_token = nn.Parameter(torch.empty(self.width))
        self.position = nn.Parameter(torch.empty(rows * rows, self.width))
        self.transformer = Transformer(self.width, depth or blocks, heads)
        self.norm = nn.LayerNorm(self.width)
        # (x / 255 - mean) / std as one product and sum
        mean, std = (torch.tensor(row).view(3, 1, 1) for row in (CLIP_MEAN, CLIP_STD))
        self.register_buffer("gain", 1 / (255 * std), persistent=False)
        self.register_buffer("shift", -mean / std, persistent=False)
        self.gain: Tensor
        self.shift: Tensor
        self.apply(init_weights)
        nn.init.normal_(self.class_token, std=0.02)
        with torch.no_grad():
            # as in `TactileViT`: with small random positions tokens start almost equal
            self.position.copy_(0.5 * sincos_grid((1, rows, rows), self.width).flatten(0, 2))
        self.requires_grad_(not frozen)

    def forward(self, images: Tensor) -> Tensor:
        """Encodes uint8 (B, 3, h, w) to (B, width)."""
        size = (self.image_size, self.image_size)
        x = F.interpolate(images.float(), size, mode="bilinear", antialias=True)
        x = torch.addcmul(self.shift, x, self.gain)
        x = self.embed(x).flatten(2).transpose(1, 2) + self.position
        x = torch.cat([self.class_token.expand(len(x), 1, -1), x], dim=1)
        out: Tensor = self.norm(self.transformer(x, only=slice(1)).flatten(1))
        return out
