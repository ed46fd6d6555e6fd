"""Fixed sine-cosine position embeddings."""

from __future__ import annotations

import math

import torch
from torch import Tensor


def sincos_grid(grid: tuple[int, int, int], width: int) -> Tensor:
    """Sines and cosines of slot, row and column: (slots, rows, columns, width).

    A quarter of the width codes the slot; row and column share the rest. The shortest wave is four
    steps long and the longest four times the axis, so that every channel distinguishes places on
    grids of any size. With the periods usual for text, up to 10,000 steps, two thirds of the
    channels would be constant on a grid of eight.
    """
    slot = width // 8 * 2
    row = (width - slot) // 4 * 2
    parts = []
    for axis, (count, size) in enumerate(zip(grid, (slot, row, width - slot - row), strict=True)):
        half = (size + 1) // 2
        falling = (1 / count) ** (torch.arange(half) / max(1, half - 1))
        angle = torch.arange(count)[:, None] * (math.pi / 2 * falling)
        code = torch.cat([angle.sin(), angle.cos()], dim=1)[:, :size]
        shape = [1, 1, 1, size]
        shape[axis] = count
        parts.append(code.view(shape).expand(*grid, size))
    return torch.cat(parts, dim=-1)


def sincos_position_embedding(grid: tuple[int, int, int], width: int) -> Tensor:
    """Sparsh's fixed positions: sines, then cosines, of each axis of the grid.

    With ``n`` axes there are ``b = ceil(width / 2n)`` frequencies ``10000 ** (-k / b)`` per axis.
    Time counts from the newest slot, and is left out for a single slot.

    Args:
        grid: Numbers of temporal slots, rows and columns.
        width: Size of a token.

    Returns:
        float32 (slots * rows * columns, width), in (slot, row, column) order.
    """
    slots, rows, columns = grid
    axes = [torch.arange(slots).flip(0), torch.arange(rows), torch.arange(columns)]
    places = torch.cartesian_prod(*axes)[:, 0 if slots > 1 else 1 :]
    count = -(-width // (2 * places.shape[1]))
    frequency = 10000 ** -(torch.arange(count, dtype=torch.float64) / count)
    angle = places[:, :, None] * frequency
    # float64 up to here: sines of large angles lose digits in float32
    return torch.cat([angle.sin(), angle.cos()], dim=-1).flatten(1)[:, :width].float()
