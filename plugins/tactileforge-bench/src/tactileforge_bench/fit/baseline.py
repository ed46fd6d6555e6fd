"""Base of the stand-ins for a touch encoder in a bench."""

from __future__ import annotations

from torch import nn

from tactileforge.encoders import ANYTOUCH2, Preprocess


class Baseline(nn.Module):
    """Two frames of any sensor, in patches; a class of its own sets `width` and `projected`.

    Args:
        size: Height and width of its input.
        patch: Rows and columns of a patch.

    Attributes:
        frames: 2.
        width: Size of a token.
        projected: Size of what stands for the class token.
    """

    width: int
    projected: int

    def __init__(self, size: int, patch: int) -> None:
        super().__init__()
        self.frames, self.tube, self.prefix, self.patch = 2, 2, 0, patch
        self.image_size = (size, size)
        self.grid = (1, size // patch, size // patch)
        # knows none by name, and takes any
        self.sensors: dict[str, int] = {}
        self.pixels = Preprocess.of(self.image_size, ANYTOUCH2)
