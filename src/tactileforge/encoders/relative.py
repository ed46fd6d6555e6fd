"""Relative position bias of attention, by the offset between two patches."""

from __future__ import annotations

from typing import Literal, TypeAlias

import torch
from torch import Tensor, nn
from torch.nn import functional as F

#: Initial bias: none at all, 0, or one neighbour for every head.
Relative: TypeAlias = Literal["none", "zero", "neighbours"]

#: Initial row and column offsets from query to key, taken by the heads in turn.
NEIGHBOURS = ((0, -1), (0, 1), (-1, 0), (1, 0), (0, 0), (-1, -1), (1, 1), (-1, 1), (1, -1))


class RelativeBias(nn.Module):
    """A learned bias of attention scores, one number per head and offset.

    Offsets are of slot, row and column. With ``start="neighbours"`` head ``h`` starts with
    ``-2 ((dr - r_h)**2 + (dc - c_h)**2 + |ds|)``, so that it attends to the neighbour at
    ``(r_h, c_h)``, or to the nearest visible patch. Filling in from neighbours is then linear from
    the first step, a solution that attention with absolute positions takes long to find. Tokens
    before the patches have no position; one number per head biases how much patches attend to them,
    little at first.
    Sources: relative bias, Raffel et al. 2020 (T5), section 2.1; the initial values, d'Ascoli et
    al. 2021 (ConViT), section 2.

    Args:
        heads: Number of attention heads.
        grid: Numbers of temporal slots, rows and columns.
        prefix: Number of tokens before the patches.
        start: Initial bias: ``zero`` or ``neighbours``.
    """

    def __init__(
        self,
        heads: int,
        grid: tuple[int, int, int],
        prefix: int,
        start: Literal["zero", "neighbours"],
    ) -> None:
        super().__init__()
        self.prefix = prefix
        self.slots, self.count = grid[0], grid[1] * grid[2]
        sizes = [2 * count - 1 for count in grid]
        offsets = torch.cartesian_prod(*(torch.arange(1.0 - count, count) for count in grid))
        table = torch.zeros(heads, len(offsets))
        if start == "neighbours":
            turns = [NEIGHBOURS[head % len(NEIGHBOURS)] for head in range(heads)]
            apart = offsets[:, 1:] - torch.tensor(turns)[:, None].float()
            table = -2 * (apart.square().sum(-1) + offsets[:, 0].abs())
        self.table = nn.Parameter(table)
        # little of class and sensor tokens, which otherwise drown the neighbours (docs/design.md)
        self.ahead = nn.Parameter(torch.full((heads,), -4.0 if start == "neighbours" else 0.0))
        places = torch.cartesian_prod(*(torch.arange(count) for count in grid))
        steps = places[None] - places[:, None] + torch.tensor(grid) - 1
        rows = (steps[..., 0] * sizes[1] + steps[..., 1]) * sizes[2] + steps[..., 2]
        self.register_buffer("rows", rows, persistent=False)
        self.rows: Tensor

    @classmethod
    def of(
        cls, relative: Relative, heads: int, grid: tuple[int, int, int], prefix: int
    ) -> RelativeBias | None:
        """Builds the bias of a configuration; None for ``relative="none"``."""
        return None if relative == "none" else cls(heads, grid, prefix, relative)

    def forward(self, kept: Tensor | None = None) -> Tensor:
        """Biases of the scores, (1 or B, heads, L, L): query before key.

        Args:
            kept: int64 (B, K), visible spatial positions; None for all.
        """
        rows = self.rows[None]
        if kept is not None:
            places = torch.cat([kept + slot * self.count for slot in range(self.slots)], dim=1)
            rows = self.rows[places[:, :, None], places[:, None, :]]
        among = self.table[:, rows].transpose(0, 1)
        ahead = self.ahead.view(1, -1, 1, 1).expand(len(among), -1, among.shape[2], self.prefix)
        # queries of class and sensor tokens have no bias
        return F.pad(torch.cat([ahead, among], dim=3), (0, 0, self.prefix, 0))
