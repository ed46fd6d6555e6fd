"""Base of policy heads."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import torch
from torch import Tensor, nn

from tactileforge.contracts import Batch, Encoder, Views
from tactileforge.errors import ConfigError
from tactileforge_policies.heads.example import example
from tactileforge_policies.heads.observation import Observation
from tactileforge_policies.heads.ranges import Ranges

if TYPE_CHECKING:
    from tactileforge_policies.data.samples import EpisodeClips


@dataclass(frozen=True)
class ChunkPrediction:
    """A head's prediction for a chunk of commands, and its target.

    Attributes:
        predicted: Commands from -1 to 1, or the noise in them, float (B, H, A).
        target: True commands or noise, float (B, H, A).
        unit: Size of 1 in the robot's units, float (A,); None where noise is predicted.
    """

    predicted: Tensor
    target: Tensor
    unit: Tensor | None = None


class PolicyHead(nn.Module):
    """Observation and ranges of commands; a subclass adds the prediction of commands.

    Args:
        encoder: The touch encoder.
        facts: Metadata of the demonstrations, see `robot.Robot`.
        execute: Commands carried out of a chunk before the next is predicted.
        pooler: Options of the pooling of touch; see `observation.PoolerSize`.

    Attributes:
        robot: Sizes of the demonstrations.
        execute: Commands carried out of a chunk before the next is predicted.

    Raises:
        ConfigError: ``execute`` is below 1 or above the predicted commands; or see `Observation`.
    """

    #: Metadata that must be equal in a run and in the run it starts from.
    fixed_facts: ClassVar[tuple[str, ...]] = ("state_size", "action_size", "fingers", "sensors")

    def __init__(
        self,
        encoder: Encoder,
        facts: Mapping[str, Any],
        execute: int,
        pooler: Mapping[str, Any],
    ) -> None:
        super().__init__()
        self.observe = Observation(encoder, facts, pooler)
        self.robot = self.observe.robot
        if not 1 <= execute <= self.robot.horizon:
            raise ConfigError(
                f"execute={execute} of a chunk of {self.robot.horizon}: give 1 to "
                f"{self.robot.horizon}, or a longer data.horizon"
            )
        self.execute = execute
        self.action = Ranges(self.robot.action_size)

    def prepare(self, clips: EpisodeClips) -> None:
        """Measures the ranges of states, commands and forces; see `contracts.Prepared`."""
        ranges = clips.ranges()
        self.action.fit(*ranges["action"])
        self.observe.state.fit(*ranges["state"])
        if self.observe.force is not None:
            self.observe.force.fit(*ranges["force"])

    @staticmethod
    def example(batch: Batch) -> tuple[dict[str, Any], Batch]:
        """Metadata and columns of one finger for the conformance suite; see `testing.batches`."""
        return example(batch)

    @abstractmethod
    def forward(self, views: Views, batch: Batch) -> ChunkPrediction:
        """Predicts for its objective."""

    @abstractmethod
    def chunk(self, views: Views, batch: Batch, generator: torch.Generator) -> Tensor:
        """Predicts commands from -1 to 1, float (B, H, A).

        Args:
            views: Views of the touches.
            batch: The batch, without ``action_chunk``.
            generator: Generator of random numbers, where the head needs some.
        """

    @torch.no_grad()
    def act(self, views: Views, batch: Batch, generator: torch.Generator) -> Tensor:
        """Predicts commands in the robot's units, float (B, H, A), within their ranges.

        The arguments are those of `chunk`.
        """
        return self.action.invert(self.chunk(views, batch, generator).clamp(-1, 1))


class DirectHead(PolicyHead):
    """A policy with direct prediction of commands, without random numbers."""

    @abstractmethod
    def predict(self, views: Views, batch: Batch) -> Tensor:
        """Predicts commands from -1 to 1, float (B, H, A)."""

    def forward(self, views: Views, batch: Batch) -> ChunkPrediction:
        """Predicted and demonstrated commands, from -1 to 1."""
        target = self.action(batch["action_chunk"])
        return ChunkPrediction(self.predict(views, batch), target, self.action.unit)

    def chunk(self, views: Views, batch: Batch, generator: torch.Generator) -> Tensor:
        """Predicts commands from -1 to 1; see `PolicyHead.chunk`."""
        return self.predict(views, batch)
