"""The head ``act``: action chunking with a transformer."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import torch
from torch import Tensor, nn

from tactileforge.contracts import Batch, Encoder, Views
from tactileforge.encoders import AttentivePooler, Transformer, init_weights
from tactileforge_policies.heads.base import DirectHead
from tactileforge_policies.heads.observation import POOLER


class ActHead(DirectHead):
    """A transformer over the observation, read by one learned query for each command.

    Small, and without the variational encoder of the original (its style variable is 0 at test
    time). Source: Zhao et al. 2023, Action Chunking with Transformers.

    Args:
        encoder: The touch encoder (passed by the framework).
        facts: Metadata of the demonstrations (passed by the framework), see `robot.Robot`.
        width: Size of a token.
        depth: Number of transformer blocks over the observation.
        heads: Number of attention heads.
        execute: Commands carried out of a chunk; see `base.PolicyHead`.
        pooler: Options of the pooling of touch; see `observation.PoolerSize`.
    """

    def __init__(
        self,
        encoder: Encoder,
        facts: Mapping[str, Any],
        width: int = 128,
        depth: int = 2,
        heads: int = 4,
        execute: int = 2,
        pooler: Mapping[str, Any] = POOLER,
    ) -> None:
        super().__init__(encoder, facts, execute, pooler)
        self.of_touch = nn.Linear(self.observe.width, width) if self.observe.touches else None
        self.of_rest = nn.Linear(self.observe.rest, width)
        self.place = nn.Parameter(0.02 * torch.randn(self.observe.touches + 1, width))
        self.transformer = Transformer(width, depth, heads)
        self.decoder = AttentivePooler(width, self.robot.horizon, heads)
        self.out = nn.Linear(width, self.robot.action_size)
        self.transformer.apply(init_weights)

    def predict(self, views: Views, batch: Batch) -> Tensor:
        """Predicts commands from -1 to 1; see `DirectHead.predict`."""
        touch, rest = self.observe(views, batch)
        tokens = self.of_rest(rest)[:, None]
        if self.of_touch is not None:
            tokens = torch.cat([tokens, self.of_touch(touch)], dim=1)
        out: Tensor = self.out(self.decoder(self.transformer(tokens + self.place)))
        return out
