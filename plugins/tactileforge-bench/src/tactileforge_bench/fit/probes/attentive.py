"""The probe ``attentive``: attention pooling with one learned query (Cloth)."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import ClassVar

import torch
from torch import Tensor, nn
from torch.nn import functional as F

from tactileforge.encoders import AttentivePooler
from tactileforge.errors import ConfigError
from tactileforge_bench.fit.probes.base import Probe, ProbeTraining, Values
from tactileforge_bench.tasks.targets import TargetPart


class Pooler(AttentivePooler):
    """`AttentivePooler` with one query, as published, in the cheapest order of operations.

    The query does not depend on the tokens, so it is taken through the key projection instead of
    every token, and the value projection is applied to what was read: 2 L W^2 multiplications
    become 2 L W heads. The result is the same but for rounding.

    Weights start as published at a width of 768: truncated normal of 0.02, biases 0, the two
    layers that write to the residual divided by sqrt(2). Narrower ones keep the variance.

    Args:
        width: Size of a token.
        heads: Attention heads.

    Raises:
        ConfigError: The heads do not divide the width.
    """

    def __init__(self, width: int, heads: int = 16) -> None:
        if width % heads:
            raise ConfigError(f"probe: {heads} heads do not divide tokens of {width}; set heads")
        super().__init__(width, 1, heads)
        for layer in self.modules():
            if isinstance(layer, nn.Linear):
                nn.init.trunc_normal_(layer.weight, std=0.02 * math.sqrt(768 / width))
        with torch.no_grad():
            # V-JEPA's pooler divides what a residual block adds by sqrt(2 x depth), here 1
            for weight in (self.out.weight, self.mlp[2].get_parameter("weight")):
                weight /= math.sqrt(2)

    def forward(self, tokens: Tensor) -> Tensor:
        """(B, L, width) to (B, width)."""
        width, heads = tokens.shape[-1], self.heads
        size = width // heads
        # not affected by the members of a batch of probes: computed once for all
        normed = F.layer_norm(tokens, (width,), eps=self.norm1.eps)
        query = self.q(self.queries[0, 0]).view(heads, size)
        key, value = self.kv.weight.view(2, heads, size, width).unbind(0)
        bias = self.kv.bias.view(2, heads, size)[1]
        asked = torch.einsum("hd,hdw->hw", query, key) * self.norm1.weight / math.sqrt(size)
        scores = (normed.flatten(0, 1) @ asked.T).view(*tokens.shape[:2], heads)
        read = scores.softmax(1).transpose(1, 2) @ normed
        read = read * self.norm1.weight + self.norm1.bias
        read = (torch.einsum("bhw,hdw->bhd", read, value) + bias).flatten(1)
        x = self.queries[0] + self.out(read)
        out: Tensor = x + self.mlp(self.norm2(x))
        return out


class Attentive(Probe):
    """A pooler, and one linear layer per part.

    Source: AnyTouch 2's published probe of Cloth.

    Args:
        width: Size of a token.
        parts: Parts of the target.
        heads: Attention heads.
    """

    published: ClassVar[ProbeTraining] = ProbeTraining(schedule="cosine")

    def __init__(self, width: int, parts: Mapping[str, TargetPart], heads: int = 16) -> None:
        super().__init__(width, parts)
        self.pooler = Pooler(width, heads)
        self.head = nn.ModuleDict({k: nn.Linear(width, part.outputs) for k, part in parts.items()})

    def forward(self, features: Tensor) -> Values:
        """(B, L, width) to (B, outputs) of each part."""
        pooled = self.pooler(features)
        return {name: head(pooled) for name, head in self.head.items()}
