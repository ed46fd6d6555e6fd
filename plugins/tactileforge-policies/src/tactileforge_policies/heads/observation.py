"""Observation of a policy: touch of each finger, camera and proprioception, as vectors."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import torch
from torch import Tensor, nn

from tactileforge.contracts import Batch, Encoder, Views
from tactileforge.encoders import AttentivePooler, Transformer
from tactileforge.errors import ConfigError
from tactileforge_policies.heads.camera import CameraNet
from tactileforge_policies.heads.ranges import Ranges
from tactileforge_policies.robot import Robot


@dataclass(frozen=True, kw_only=True)
class PoolerSize:
    """Size of the pooler of each finger.

    Attributes:
        queries: Number of learned queries, with one vector each.
        width: Size of such a vector.
        depth: Number of blocks: one to read the tokens, the others among the queries.
        heads: Number of attention heads, a divisor of the width.
    """

    queries: int = 30
    width: int = 32
    depth: int = 1
    heads: int = 4


#: Default size of the pooler.
POOLER = asdict(PoolerSize())


class TouchPooler(nn.Module):
    """Pools tokens of one finger to a few vectors: a norm, a projection, `AttentivePooler`.

    Args:
        tokens: Size of a token of the encoder.
        size: Size of the pooler.
    """

    def __init__(self, tokens: int, size: PoolerSize) -> None:
        super().__init__()
        self.norm = nn.LayerNorm(tokens)
        self.project = nn.Linear(tokens, size.width)
        self.pooler = AttentivePooler(size.width, size.queries, size.heads)
        self.mix = Transformer(size.width, size.depth - 1, size.heads)

    def forward(self, tokens: Tensor) -> Tensor:
        """Maps (B, L, tokens) to (B, queries, width)."""
        out: Tensor = self.mix(self.pooler(self.project(self.norm(tokens))))
        return out


def flat(perceived: tuple[Tensor, Tensor]) -> Tensor:
    """Joins the output of `Observation` to one vector, (B, numbers)."""
    touch, rest = perceived
    return torch.cat([touch.flatten(1), rest], dim=1)


class Observation(nn.Module):
    """Vectors of touch, (B, F queries, width), and one of all else, (B, rest).

    Each finger has a pooler of its own, as each encoder has in the paper. Proprioception and forces
    are normalised to -1..1 by their ranges in the training data.

    Args:
        encoder: The touch encoder.
        facts: Metadata of the demonstrations, see `robot.Robot`.
        pooler: Options of `PoolerSize`.

    Attributes:
        width: Size of a vector of touch.
        touches: Number of vectors of touch; 0 without touch.
        rest: Size of the vector of all else.

    Raises:
        ConfigError: The metadata of demonstrations are missing, or the heads do not divide the
            width.
    """

    def __init__(
        self, encoder: Encoder, facts: Mapping[str, Any], pooler: Mapping[str, Any]
    ) -> None:
        super().__init__()
        robot = Robot.of(facts)
        size = PoolerSize(**pooler)
        if size.width % size.heads:
            raise ConfigError(
                f"pooler: {size.heads} heads do not divide a width of {size.width}; change one"
            )
        self.robot = robot
        fingers = len(robot.fingers) if robot.touch == "frames" else 0
        self.poolers = nn.ModuleList(TouchPooler(encoder.width, size) for _ in range(fingers))
        self.camera = CameraNet() if robot.image_size else None
        self.state = Ranges(robot.state_size)
        self.force = Ranges(3 * len(robot.fingers)) if robot.touch == "force" else None
        self.width, self.touches = size.width, fingers * size.queries
        self.rest = robot.observations * (
            robot.state_size
            + (self.camera.width if self.camera else 0)
            + (3 * len(robot.fingers) if self.force else 0)
        )

    @property
    def flat(self) -> int:
        """Total size of all vectors."""
        return self.rest + self.touches * self.width

    def forward(self, views: Views, batch: Batch) -> tuple[Tensor, Tensor]:
        """Computes touch, float (B, touches, width), and the rest, float (B, rest)."""
        rest = [self.state(batch["state"]).flatten(1)]
        if self.camera is not None:
            images = batch["images"]
            rest.append(self.camera(images.flatten(0, 1)).view(len(images), -1))
        if self.force is not None:
            rest.append(self.force(batch["forces"]).flatten(1))
        vector = torch.cat(rest, dim=1)
        if not self.touches:
            return vector.new_zeros(len(vector), 0, self.width), vector
        found = views.full.tokens
        tokens = found.view(len(vector), -1, *found.shape[1:])
        pooled = [pool(tokens[:, finger]) for finger, pool in enumerate(self.poolers)]
        return torch.cat(pooled, dim=1), vector
