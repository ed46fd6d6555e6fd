"""Points of a plane, for tests of closed forms."""

import torch
from torch import Tensor


def plane(points: int, spacing: float) -> tuple[Tensor, Tensor]:
    """x and y, (points, points), around 0."""
    line = (torch.arange(points) - (points - 1) / 2) * spacing
    y, x = torch.meshgrid(line, line, indexing="ij")
    return x, y
