"""Base of the heads that act."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import torch
from torch import Tensor, nn

from tactileforge.plugin import Batch, ConfigError, Encoder, Views
from tactileforge_policies.heads.example import example
from tactileforge_policies.heads.observation import Observation
from tactileforge_policies.heads.ranges import Ranges

if TYPE_CHECKING:
    from tactileforge_policies.data.samples import EpisodeClips


@dataclass(frozen=True)
class ChunkPrediction:
    """A head's prediction for a chunk of commands, and what it should be.

    Attributes:
        predicted: float (B, H, A): commands from -1 to 1, or the noise in them.
        target: Alike.
        unit: float (A,), the robot's units that count as 1; None where noise is predicted.
    """

    predicted: Tensor
    target: Tensor
    unit: Tensor | None = None


class PolicyHead(nn.Module):
    """Perception and the ranges of commands; a subclass says how commands follow.

    Args:
        encoder: The touch encoder.
        facts: Of the demonstrations, see `robot.Robot`.
        execute: Commands of a chunk that are carried out before the next is predicted.
        pooler: See `observation.PoolerSize`.

    Attributes:
        robot: Sizes of the demonstrations.
        execute: See the arguments.

    Raises:
        ConfigError: More commands are to be executed than are predicted; see `Observation`.
    """

    #: A run that starts from another has to have these of its data.
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
        """Facts and columns of one finger for the conformance suite; see `testing.batches`."""
        return example(batch)

    @abstractmethod
    def forward(self, views: Views, batch: Batch) -> ChunkPrediction:
        """The prediction that its objective understands."""

    @abstractmethod
    def chunk(self, views: Views, batch: Batch, generator: torch.Generator) -> Tensor:
        """Commands from -1 to 1, float (B, H, A).

        Args:
            views: Of the touches.
            batch: Without ``action_chunk``.
            generator: Of the random numbers, where it needs some.
        """

    @torch.no_grad()
    def act(self, views: Views, batch: Batch, generator: torch.Generator) -> Tensor:
        """Commands in the robot's units, float (B, H, A), within their ranges; see `chunk`."""
        return self.action.invert(self.chunk(views, batch, generator).clamp(-1, 1))


class DirectHead(PolicyHead):
    """A policy that predicts commands themselves, without random numbers."""

    @abstractmethod
    def predict(self, views: Views, batch: Batch) -> Tensor:
        """Commands from -1 to 1, float (B, H, A)."""

    def forward(self, views: Views, batch: Batch) -> ChunkPrediction:
        """Commands as predicted and as demonstrated, from -1 to 1."""
        target = self.action(batch["action_chunk"])
        return ChunkPrediction(self.predict(views, batch), target, self.action.unit)

    def chunk(self, views: Views, batch: Batch, generator: torch.Generator) -> Tensor:
        """Commands from -1 to 1; see `PolicyHead.chunk`."""
        return self.predict(views, batch)
