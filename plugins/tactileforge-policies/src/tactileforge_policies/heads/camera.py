"""A small convolutional network for the camera image, trained with the policy."""

from __future__ import annotations

from itertools import pairwise

import torch
from torch import Tensor, nn

#: Channels after each stride of 2.
_CHANNELS = (16, 32, 64)


class CameraNet(nn.Module):
    """Three strided convolutions, and the expected place of each of ``points`` feature maps.

    It is trained from scratch, as no pre-trained weights have to be downloaded then; the paper uses
    a frozen ResNet-50 of ImageNet. Source of the spatial softmax: Levine et al. 2016, and Diffusion
    Policy.

    Args:
        points: Number of places read from an image.

    Attributes:
        width: Size of the vector of an image, two numbers per place.
    """

    def __init__(self, points: int = 32) -> None:
        super().__init__()
        widths = (3, *_CHANNELS)
        layers: list[nn.Module] = []
        for before, after in pairwise(widths):
            layers += [nn.Conv2d(before, after, 3, 2, 1), nn.GroupNorm(8, after), nn.ReLU()]
        self.layers = nn.Sequential(*layers, nn.Conv2d(_CHANNELS[-1], points, 1))
        self.width = 2 * points

    def forward(self, images: Tensor) -> Tensor:
        """Maps uint8 (N, 3, h, w) to (N, width), places in -1..1: x of all points, then y."""
        maps: Tensor = self.layers(images.float() / 127.5 - 1)
        rows, columns = maps.shape[-2:]
        share = maps.flatten(2).softmax(-1).view_as(maps)
        x = (share.sum(-2) * torch.linspace(-1, 1, columns, device=maps.device)).sum(-1)
        y = (share.sum(-1) * torch.linspace(-1, 1, rows, device=maps.device)).sum(-1)
        return torch.cat([x, y], dim=-1)
