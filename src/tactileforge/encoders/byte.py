"""A small text tower over bytes: trained from scratch, nothing to download."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor, nn

from tactileforge.encoders.transformer import Transformer, init_weights

_PAD = 256  # the first id after those of the bytes


class ByteEncoder(nn.Module):
    """UTF-8 text to one vector: a transformer over bytes, averaged over the text's own bytes.

    Args:
        width: Size of the vector.
        depth: Number of blocks.
        heads: Number of attention heads.
        length: Largest number of bytes; the rest is cut off.

    Example:
        >>> ByteEncoder()(["a soft sponge", ""]).shape
        torch.Size([2, 192])
    """

    modality = "text"

    def __init__(self, width: int = 192, depth: int = 2, heads: int = 3, length: int = 96) -> None:
        super().__init__()
        self.width = width
        self.length = length
        self.embed = nn.Embedding(_PAD + 1, width)
        self.position = nn.Parameter(torch.empty(length, width))
        self.transformer = Transformer(width, depth, heads)
        self.norm = nn.LayerNorm(width)
        self.apply(init_weights)
        nn.init.normal_(self.embed.weight, std=0.02)
        nn.init.normal_(self.position, std=0.02)

    def forward(self, text: Sequence[str]) -> Tensor:
        """Encodes B strings to (B, width)."""
        # a cut may fall into a character: bytes are embedded, not characters
        rows = [list(line.encode()[: self.length]) for line in text]
        longest = max(1, max(len(row) for row in rows))
        ids = torch.tensor([row + [_PAD] * (longest - len(row)) for row in rows])
        ids = ids.to(self.position.device, non_blocking=True)
        seen = ids != _PAD
        seen[:, 0] = True  # an empty text is one padding token: attention over none gives NaN
        x = self.embed(ids) + self.position[:longest]
        x = self.norm(self.transformer(x, seen[:, None, None, :]))
        weight = seen[..., None].to(x.dtype)
        mean: Tensor = (x * weight).sum(1) / weight.sum(1)
        return mean
