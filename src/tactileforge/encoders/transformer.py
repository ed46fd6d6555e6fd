"""The transformer block that encoders, towers and decoders share."""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.nn import functional as F

#: Width, depth and heads of each size.
SIZES = {"tiny": (192, 6, 3), "small": (384, 12, 6), "base": (768, 12, 12)}


def mlp(width: int) -> nn.Sequential:
    """Two layers, four times as wide between them."""
    return nn.Sequential(nn.Linear(width, 4 * width), nn.GELU(), nn.Linear(4 * width, width))


class Attention(nn.Module):
    """Multi-head self-attention with one fused projection for query, key and value."""

    def __init__(self, width: int, heads: int) -> None:
        super().__init__()
        self.heads = heads
        self.qkv = nn.Linear(width, 3 * width)
        self.out = nn.Linear(width, width)

    def forward(self, x: Tensor, mask: Tensor | None = None) -> Tensor:
        """Attends over (B, L, width); ``mask`` is bool (B, 1, 1, L), True where a key is seen."""
        query, key, value = (
            self.qkv(x).unflatten(-1, (3, self.heads, -1)).permute(2, 0, 3, 1, 4).unbind(0)
        )
        x = F.scaled_dot_product_attention(query, key, value, attn_mask=mask)
        out: Tensor = self.out(x.transpose(1, 2).flatten(2))
        return out


class Block(nn.Module):
    """Pre-norm block: attention and a GELU MLP of four times the width, each with a residual."""

    def __init__(self, width: int, heads: int, eps: float = 1e-5) -> None:
        super().__init__()
        self.norm1 = nn.LayerNorm(width, eps)
        self.attention = Attention(width, heads)
        self.norm2 = nn.LayerNorm(width, eps)
        self.mlp = nn.Sequential(
            nn.Linear(width, 4 * width), nn.GELU(), nn.Linear(4 * width, width)
        )

    def forward(self, x: Tensor, mask: Tensor | None = None) -> Tensor:
        """(B, L, width) to the same."""
        x = x + self.attention(self.norm1(x), mask)
        out: Tensor = x + self.mlp(self.norm2(x))
        return out


class Transformer(nn.Module):
    """A stack of `Block`."""

    def __init__(self, width: int, depth: int, heads: int, eps: float = 1e-5) -> None:
        super().__init__()
        self.blocks = nn.ModuleList(Block(width, heads, eps) for _ in range(depth))

    def forward(self, x: Tensor, mask: Tensor | None = None) -> Tensor:
        """(B, L, width) to the same."""
        for block in self.blocks:
            x = block(x, mask)
        return x


class AttentivePooler(nn.Module):
    """Learned queries that read tokens through one cross-attention block.

    The queries enter un-normed, keys and values are normed; block as in the published probe of
    AnyTouch 2.

    Args:
        width: Size of a token, and of what is read.
        queries: Number of queries.
        heads: Attention heads.
    """

    def __init__(self, width: int, queries: int, heads: int) -> None:
        super().__init__()
        self.heads = heads
        self.queries = nn.Parameter(torch.zeros(1, queries, width))
        self.norm1 = nn.LayerNorm(width)
        self.q = nn.Linear(width, width)
        self.kv = nn.Linear(width, 2 * width)
        self.out = nn.Linear(width, width)
        self.norm2 = nn.LayerNorm(width)
        self.mlp = nn.Sequential(
            nn.Linear(width, 4 * width), nn.GELU(), nn.Linear(4 * width, width)
        )
        self.apply(init_weights)
        nn.init.trunc_normal_(self.queries, std=0.02)

    def forward(self, tokens: Tensor) -> Tensor:
        """(B, L, width) to (B, queries, width)."""
        queries = self.queries.expand(len(tokens), -1, -1)
        query = self.q(queries).unflatten(-1, (self.heads, -1)).transpose(1, 2)
        key, value = (
            self.kv(self.norm1(tokens))
            .unflatten(-1, (2, self.heads, -1))
            .permute(2, 0, 3, 1, 4)
            .unbind(0)
        )
        read = F.scaled_dot_product_attention(query, key, value).transpose(1, 2).flatten(2)
        x = queries + self.out(read)
        out: Tensor = x + self.mlp(self.norm2(x))
        return out


def init_weights(module: nn.Module) -> None:
    """Linear weights keep the variance of what they read; biases are 0. For ``Module.apply``.

    A standard deviation of 0.02, usual at a width of 768, makes narrow encoders blind: at 192 the
    class tokens of different touches start with a cosine of 0.9998, and stay there for long.
    """
    if isinstance(module, nn.Linear):
        nn.init.normal_(module.weight, std=module.in_features**-0.5)
        if module.bias is not None:
            nn.init.zeros_(module.bias)


def size_of(size: str) -> tuple[int, int, int]:
    """Width, depth and heads of a named size.

    Raises:
        ValueError: No such size; lists the known ones.
    """
    if size not in SIZES:
        raise ValueError(f"unknown size {size!r}: choose one of {', '.join(SIZES)}")
    return SIZES[size]
