"""The head ``regression``: commands as a function of what is perceived."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from torch import Tensor, nn

from tactileforge.plugin import Batch, Encoder, Views
from tactileforge_policies.heads.base import DirectHead
from tactileforge_policies.heads.observation import POOLER, flat


class RegressionHead(DirectHead):
    """Two hidden layers on all that is perceived: the plainest policy.

    Where demonstrations act in several ways, it takes their mean.

    Args:
        encoder: The touch encoder (given by the framework).
        facts: Of the demonstrations (given by the framework), see `robot.Robot`.
        hidden: Width of the hidden layers.
        execute: See `base.PolicyHead`.
        pooler: See `observation.PoolerSize`.
    """

    def __init__(
        self,
        encoder: Encoder,
        facts: Mapping[str, Any],
        hidden: int = 256,
        execute: int = 2,
        pooler: Mapping[str, Any] = POOLER,
    ) -> None:
        super().__init__(encoder, facts, execute, pooler)
        out = self.robot.horizon * self.robot.action_size
        self.layers = nn.Sequential(
            nn.Linear(self.observe.flat, hidden),
            nn.GELU(),
            nn.Linear(hidden, hidden),
            nn.GELU(),
            nn.Linear(hidden, out),
        )

    def predict(self, views: Views, batch: Batch) -> Tensor:
        """Commands from -1 to 1; see `DirectHead.predict`."""
        out: Tensor = self.layers(flat(self.observe(views, batch)))
        return out.view(len(out), self.robot.horizon, self.robot.action_size)
