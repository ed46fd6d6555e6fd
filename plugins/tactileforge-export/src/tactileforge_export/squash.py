"""Resizing of uint8 images as by OpenCV in training, in operators available to graphs."""

from __future__ import annotations

import torch
from torch import Tensor, nn

from tactileforge.data import AVERAGED_FROM


class Squash(nn.Module):
    """Resizes images to a size, equal to `data.batches.clips.resize_frame` within a grey level.

    Weights and sums are whole numbers, so that rounding is the same wherever the graph runs. The
    choice between averaging and interpolation is part of the graph, so that it takes any size.

    Args:
        size: Height and width of the result, pixels.
    """

    def __init__(self, size: tuple[int, int]) -> None:
        super().__init__()
        self.size = size

    def forward(self, images: Tensor) -> Tensor:
        """Resizes to float32 (..., 3, height, width), of whole numbers.

        Args:
            images: uint8 (..., 3, H, W).
        """
        ways = [
            _ways(images, axis, wanted) for axis, wanted in zip((-2, -1), self.size, strict=True)
        ]
        shrinks = [length / wanted for (_, _, length), wanted in zip(ways, self.size, strict=True)]
        least, most = torch.minimum(*shrinks), torch.maximum(*shrinks)
        averages = (least >= 1) & (most >= AVERAGED_FROM)
        rows, columns = (torch.where(averages, mean, line) for mean, line, _ in ways)
        # the first sums are below 2 ** 24, so exact in float32; the second need float64
        sums = (rows @ images.float()).double() @ columns.double().T
        whole = rows[0].double().sum() * columns[0].double().sum()
        exact = sums / whole
        # OpenCV rounds means half to even, those of 2 x 2 pixels half up, and cuts an eighth off
        # what it interpolates
        twice = (shrinks[0] == 2) & (shrinks[1] == 2)
        rounded = torch.floor(exact + torch.where(averages, 0.5, 0.375))
        return torch.where(averages & ~twice, torch.round(exact), rounded).float()


def _ways(images: Tensor, axis: int, wanted: int) -> tuple[Tensor, Tensor, Tensor]:
    """Weights (wanted, length) of averaging and of bilinear interpolation, and the length."""
    length = images.shape[axis]
    pixel = torch.arange(length, device=images.device)
    place = torch.arange(wanted, device=images.device)[:, None]
    count = pixel.amax(0) + 1
    # in units of 1 / wanted pixel: overlap of a pixel of the result with each pixel of the image
    low, high = place * count, (place + 1) * count
    ends = torch.minimum(high, (pixel + 1) * wanted) - torch.maximum(low, pixel * wanted)
    # in units of half of that: distance from the centre, clamped to the image
    unit = 2 * wanted
    centre = ((2 * place + 1) * count - wanted).clamp(min=0)
    centre = torch.minimum(centre, unit * (count - 1))
    near = unit - (unit * pixel - centre).abs()
    return ends.clamp(min=0).float(), near.clamp(min=0).float(), count.float()
