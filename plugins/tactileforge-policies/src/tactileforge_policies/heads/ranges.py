"""Numbers of a robot, mapped to -1..1 by their ranges in the training data."""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

#: Smallest half range of a varying number; a constant one is centred, and inverted to its value.
_LEAST = 1e-6


class Ranges(nn.Module):
    """Min-max normalisation; the ranges are buffers, and start as -1..1.

    Args:
        size: Number of values.
    """

    low: Tensor
    high: Tensor

    def __init__(self, size: int) -> None:
        super().__init__()
        self.register_buffer("low", -torch.ones(size))
        self.register_buffer("high", torch.ones(size))

    def fit(self, low: NDArray[np.float32], high: NDArray[np.float32]) -> None:
        """Sets the least and largest value of each number."""
        self.low.copy_(torch.from_numpy(low))
        self.high.copy_(torch.from_numpy(high))

    def forward(self, values: Tensor) -> Tensor:
        """Normalises (..., size): ``2 (x - low) / (high - low) - 1``."""
        centre, half = self._scale()
        return (values - centre) / torch.where(half > 0, half, 1.0)

    def invert(self, values: Tensor) -> Tensor:
        """Maps (..., size) from -1..1 to the robot's units."""
        centre, half = self._scale()
        return values * half + centre

    @property
    def unit(self) -> Tensor:
        """Size of 1 in the robot's units, (size,)."""
        return self._scale()[1]

    def _scale(self) -> tuple[Tensor, Tensor]:
        half = (self.high - self.low) / 2
        return (self.high + self.low) / 2, torch.where(half > _LEAST, half, 0.0)
