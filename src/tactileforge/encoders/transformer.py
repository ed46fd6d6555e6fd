"""The transformer block shared by encoders, towers and decoders."""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.nn import functional as F

#: Width, depth and heads of each size: ViT's and DeiT's, but tiny has half of DeiT's 12 blocks.
VIT_SIZES = {
    "tiny": (192, 6, 3),
    "small": (384, 12, 6),
    "base": (768, 12, 12),
    "large": (1024, 24, 16),
}


class QuickGELU(nn.Module):
    """``x * sigmoid(1.702 x)``, the activation of OpenAI's CLIP weights."""

    def forward(self, x: Tensor) -> Tensor:
        """Applies the activation to a tensor of any shape."""
        # the approximation of GELU by Hendrycks and Gimpel (2016)
        return x * torch.sigmoid(1.702 * x)


ACTIVATIONS = {"gelu": nn.GELU, "quick_gelu": QuickGELU}


class Attention(nn.Module):
    """Multi-head self-attention with one fused projection for query, key and value.

    Args:
        width: Size of a token.
        heads: Number of attention heads.
        bias_kv: Whether a learned key and value are appended to those of the tokens (ImageBind's).
    """

    def __init__(self, width: int, heads: int, bias_kv: bool = False) -> None:
        super().__init__()
        self.heads = heads
        self.qkv = nn.Linear(width, 3 * width)
        self.out = nn.Linear(width, width)
        self.bias_kv = nn.Parameter(torch.zeros(2, width)) if bias_kv else None

    def forward(
        self,
        x: Tensor,
        mask: Tensor | None = None,
        only: slice | None = None,
        lengths: tuple[int, ...] | None = None,
    ) -> Tensor:
        """Attends over (B, L, width).

        Args:
            x: float (B, L, width).
            mask: bool (B, 1, 1, L), True for visible keys; or float (1 or B, 1 or heads, 1 or L,
                L), added to the scores of a query (third axis) and a key (fourth). None for no
                mask.
            only: Consecutive tokens to return, (B, their number, width); None for all.
            lengths: Lengths of sequences that lie one after another in L and do not see each
                other, without ``mask`` and ``only``; None for a single one.
        """
        qkv = self.qkv(x).unflatten(-1, (3, self.heads, -1))
        if lengths is None:
            read = self._read(qkv, mask, only)
        else:
            read = torch.cat([self._read(part) for part in qkv.split(lengths, dim=1)], dim=1)
        out: Tensor = self.out(read)
        return out

    def _read(self, qkv: Tensor, mask: Tensor | None = None, only: slice | None = None) -> Tensor:
        """Attended values, (B, L, width), from (B, L, 3, heads, width / heads)."""
        # taken apart before axes are swapped: so the gradient is put together in the order of `qkv`
        query, key, value = (part.transpose(1, 2) for part in qkv.unbind(2))
        if self.bias_kv is not None:
            extra = self.bias_kv.view(2, 1, self.heads, 1, -1).expand(-1, len(qkv), -1, -1, -1)
            key, value = torch.cat([key, extra[0]], dim=2), torch.cat([value, extra[1]], dim=2)
        # queries alone are cut: the others are still attended to, so nothing changes but the work
        if only is not None:
            query = query[:, :, only]
            mask = mask if mask is None or mask.shape[2] == 1 else mask[:, :, only]
        # torch takes no bias of another type than that of the queries, and parameters stay float32
        # under autocast
        if mask is not None and mask.is_floating_point():
            mask = mask.to(query.dtype)
        x = F.scaled_dot_product_attention(query, key, value, attn_mask=mask)
        return x.transpose(1, 2).flatten(2)


class Block(nn.Module):
    """Pre-norm block: attention and an MLP of four times the width, each with a residual.

    Args:
        width: Size of a token.
        heads: Number of attention heads.
        eps: Epsilon of the norms.
        activation: Activation of the MLP, a key of `ACTIVATIONS`.
        bias_kv: Whether attention has a learned key and value, see `Attention`.
        layer_scale: Initial value of a learned factor per channel on each residual; None for no
            factor.
    """

    def __init__(
        self,
        width: int,
        heads: int,
        eps: float = 1e-5,
        activation: str = "gelu",
        bias_kv: bool = False,
        layer_scale: float | None = None,
    ) -> None:
        super().__init__()
        self.norm1 = nn.LayerNorm(width, eps)
        self.attention = Attention(width, heads, bias_kv)
        self.norm2 = nn.LayerNorm(width, eps)
        self.mlp = nn.Sequential(
            nn.Linear(width, 4 * width), ACTIVATIONS[activation](), nn.Linear(4 * width, width)
        )
        self.scale1 = self.scale2 = None
        if layer_scale is not None:
            self.scale1 = nn.Parameter(torch.full((width,), layer_scale))
            self.scale2 = nn.Parameter(torch.full((width,), layer_scale))

    def forward(
        self,
        x: Tensor,
        mask: Tensor | None = None,
        only: slice | None = None,
        lengths: tuple[int, ...] | None = None,
    ) -> Tensor:
        """Transforms (B, L, width); arguments as of `Attention`."""
        change = self.attention(self.norm1(x), mask, only, lengths)
        x = x if only is None else x[:, only]
        x = x + (change if self.scale1 is None else change * self.scale1)
        change = self.mlp(self.norm2(x))
        out: Tensor = x + (change if self.scale2 is None else change * self.scale2)
        return out


class Transformer(nn.Module):
    """A stack of `Block`.

    Example:
        >>> Transformer(width=32, depth=2, heads=4)(torch.zeros(1, 5, 32)).shape
        torch.Size([1, 5, 32])
    """

    def __init__(
        self,
        width: int,
        depth: int,
        heads: int,
        eps: float = 1e-5,
        activation: str = "gelu",
        bias_kv: bool = False,
        layer_scale: float | None = None,
    ) -> None:
        super().__init__()
        self.blocks = nn.ModuleList(
            Block(width, heads, eps, activation, bias_kv, layer_scale) for _ in range(depth)
        )

    def forward(
        self,
        x: Tensor,
        mask: Tensor | None = None,
        only: slice | None = None,
        lengths: tuple[int, ...] | None = None,
    ) -> Tensor:
        """Transforms (B, L, width); arguments as of `Attention`."""
        if mask is not None and mask.dtype == torch.bool:
            mask = mask.to(x.dtype).log()  # 0 and -inf once, which torch would make in each block
        last = len(self.blocks) - 1
        for number, block in enumerate(self.blocks):
            # every block before the last needs all tokens, as the next one attends to them
            x = block(x, mask, only if number == last else None, lengths)
        return x if only is None or last >= 0 else x[:, only]


class AttentivePooler(nn.Module):
    """Learned queries, attending to tokens through one cross-attention block.

    Queries are not normed, keys and values are, as in the published probe of AnyTouch 2.

    Args:
        width: Size of a token and of an output.
        queries: Number of queries.
        heads: Number of attention heads.

    Example:
        >>> AttentivePooler(width=32, queries=3, heads=4)(torch.zeros(2, 17, 32)).shape
        torch.Size([2, 3, 32])
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
        """Pools (B, L, width) to (B, queries, width)."""
        query = self.q(self.queries).unflatten(-1, (self.heads, -1)).transpose(1, 2)
        query = query.expand(len(tokens), -1, -1, -1)
        pairs = self.kv(self.norm1(tokens)).unflatten(-1, (2, self.heads, -1)).unbind(2)
        key, value = (part.transpose(1, 2) for part in pairs)
        read = F.scaled_dot_product_attention(query, key, value).transpose(1, 2).flatten(2)
        x = self.queries + self.out(read)
        out: Tensor = x + self.mlp(self.norm2(x))
        return out


def init_weights(module: nn.Module) -> None:
    """Initialises linear weights to keep the variance of their input; for ``Module.apply``.

    Biases are 0. A standard deviation of 0.02, usual at a width of 768, makes the tokens of narrow
    encoders almost equal: at 192 the class tokens of different touches start with a cosine of
    0.9998, and stay there for long.
    """
    if isinstance(module, nn.Linear):
        nn.init.normal_(module.weight, std=module.in_features**-0.5)
        if module.bias is not None:
            nn.init.zeros_(module.bias)


def attention_heads(width: int) -> int:
    """Number of heads of about 64 channels: the largest divisor of ``width`` up to ``width // 64``.

    Example:
        >>> [attention_heads(width) for width in (48, 192, 200, 768)]
        [1, 3, 2, 12]
    """
    return next(count for count in range(max(1, width // 64), 0, -1) if width % count == 0)


def size_preset(size: str) -> tuple[int, int, int]:
    """Width, depth and heads of a named size.

    Raises:
        ValueError: The size is unknown; the message lists the known ones.
    """
    if size not in VIT_SIZES:
        raise ValueError(f"unknown size {size!r}: choose one of {', '.join(VIT_SIZES)}")
    return VIT_SIZES[size]
