"""Patches left out of a transformer of timm, and tokens added to it."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from typing import Any

import torch
from torch import Tensor, nn


class TokenChoice(nn.Module):
    """Stands at the place of timm's patch dropout: leaves out hidden patches, adds tokens.

    Args:
        prefix: Number of tokens before the patches.
        tells_kept: Whether the network wants to know which patches are left (Eva, which turns its
            positions in each block).
    """

    def __init__(self, prefix: int, tells_kept: bool) -> None:
        super().__init__()
        self.prefix, self.tells_kept = prefix, tells_kept
        self._kept: Tensor | None = None
        self._extra: Tensor | None = None

    @contextmanager
    def choosing(self, kept: Tensor | None, extra: Tensor | None) -> Iterator[None]:
        """Sets the choice of the passes within.

        Args:
            kept: int64 (B, K), visible patches; None for all.
            extra: float (B, n, width), tokens to add before the patches; None for none.
        """
        self._kept, self._extra = kept, extra
        try:
            yield
        finally:
            self._kept = self._extra = None

    def forward(self, x: Tensor) -> Any:
        """Chooses from tokens (B, L, width)."""
        kept = self._kept
        if kept is not None or self._extra is not None:
            head, patches = x[:, : self.prefix], x[:, self.prefix :]
            if kept is not None:
                patches = patches.gather(1, kept[..., None].expand(-1, -1, patches.shape[-1]))
            added = [] if self._extra is None else [self._extra.to(x.dtype)]
            x = torch.cat([head, *added, patches], dim=1)
        return (x, kept) if self.tells_kept else x


def choose_tokens(network: Any, prefix: int, extra: int) -> TokenChoice:
    """Puts a `TokenChoice` into a transformer of timm.

    Args:
        network: The transformer; see `networks.takes_tokens`.
        prefix: Its tokens before the patches.
        extra: Number of tokens that will be added.
    """
    tells_kept = isinstance(network, import_module("timm.models").Eva)
    network.patch_drop = choice = TokenChoice(prefix, tells_kept)
    if tells_kept:
        for part in network.blocks.modules():
            # tokens before the patches have no place, and are not turned
            if hasattr(part, "num_prefix_tokens"):
                part.num_prefix_tokens += extra
    return choice
