"""The head ``regression``: commands as a function of the observation."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from torch import Tensor, nn

from tactileforge.contracts import Batch, Encoder, Views
from tactileforge_policies.heads.base import DirectHead
from tactileforge_policies.heads.observation import POOLER, flat


class RegressionHead(DirectHead):
    """Two hidden layers on the observation: the simplest policy.

    Where demonstrations act in several ways, it predicts their average.

    Args:
        encoder: The touch encoder (passed by the framework).
        facts: Metadata of the demonstrations (passed by the framework), see `robot.Robot`.
        hidden: Width of the hidden layers.
        execute: Commands carried out of a chunk; see `base.PolicyHead`.
        pooler: Options of the pooling of touch; see `observation.PoolerSize`.
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
        """Predicts commands from -1 to 1; see `DirectHead.predict`."""
        out: Tensor = self.layers(flat(self.observe(views, batch)))
        return out.view(len(out), self.robot.horizon, self.robot.action_size)
