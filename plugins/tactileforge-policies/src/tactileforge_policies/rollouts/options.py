"""Options of a task, and the making of its environment."""

from __future__ import annotations

import importlib
import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from tactileforge.data import CODECS
from tactileforge.errors import ConfigError, unknown

#: Namespace of the environments of this package.
NAMESPACE = "tactileforge"
#: Steps of the longest episode of a task without a limit of its own.
LIMIT = 500
#: First seed of demonstrations; seeds of rollouts are smaller, so that none was seen in training.
FIRST_DEMONSTRATION = 1_000_000_000
#: Episodes of one ``seed``; those of different seeds do not overlap.
PER_SEED = 100_000


@dataclass(frozen=True, kw_only=True)
class TaskOptions:
    """A task and its simulation.

    Attributes:
        task: ``grasp``, ``wipe``, ``insert`` or ``chip``; or the gymnasium id of your own
            environment, as ``module:Name-v0`` (docs/manipulation.md).
        sensor: Type of sensor of both fingers.
        size: Height and width of their pictures, pixels.
        seed: Seed of starts and physics of all episodes.
        limit: Largest number of steps of an episode; None for the limit of the task.
        env: Further keys of the environment, by name.
    """

    task: str
    sensor: str = "digit"
    size: int = 64
    seed: int = 0
    limit: int | None = None
    env: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if not 0 <= self.seed < FIRST_DEMONSTRATION // PER_SEED:
            top = FIRST_DEMONSTRATION // PER_SEED - 1
            raise ConfigError(f"seed={self.seed}: give a whole number from 0 to {top}")
        if self.limit is not None and self.limit < 1:
            raise ConfigError(f"limit={self.limit}: give 1 step or more")

    def episode_seed(self, number: int) -> int:
        """Seed of a rollout; it gives every policy the same start and physics.

        Example:
            >>> TaskOptions(task="chip", seed=2).episode_seed(7)
            200007
        """
        return self.seed * PER_SEED + number

    @property
    def word(self) -> str:
        """Name of the task in keys and folders."""
        return self.task.rpartition(":")[2].rpartition("/")[2].removesuffix("-v0").lower()


@dataclass(frozen=True, kw_only=True)
class DemonstrationOptions(TaskOptions):
    """Demonstrations of the scripted expert, as shards for the training of policies.

    Attributes:
        out: Folder of the shards.
        n: Number of successful episodes to store; failures of the expert are left out and listed.
        noise: Standard deviation of the noise added to the expert's actions before they are carried
            out, as a share of the largest action. The actions are stored without it, so that a
            policy learns how the expert recovers (Laskey et al. 2017, DART).
        units: Units of the sensors, one per episode, in turns, so that gels and lights vary; None
            for the unit of ``env``.
        codec: Codec of the pictures: png or webp, without loss, or jpg (quality 95).
        processes: Number of simulating processes; None for one per core.
    """

    out: str
    n: int = 50
    noise: float = 0.1
    units: list[int] | None = None
    codec: str = "png"
    processes: int | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        if not 1 <= self.n <= PER_SEED // 4:
            raise ConfigError(f"n={self.n}: give 1 to {PER_SEED // 4} episodes")
        if not 0 <= self.noise <= 1:
            raise ConfigError(f"noise={self.noise}: give a share from 0 to 1 of the largest action")
        if self.units is not None and (not self.units or "unit" in self.env):
            raise ConfigError(f"units={self.units}: give one or more, and env.unit= not beside it")
        if self.codec not in CODECS:
            raise ConfigError(f"codec={self.codec}; give one of {', '.join(CODECS)}")

    def episode_seed(self, number: int) -> int:
        """Seed of a demonstration, distinct from those of all rollouts.

        Example:
            >>> DemonstrationOptions(task="chip", out="x").episode_seed(7)
            1000000007
        """
        return FIRST_DEMONSTRATION + super().episode_seed(number)

    def of_unit(self, number: int) -> DemonstrationOptions:
        """Options with the sensor unit of an episode in ``env``."""
        if self.units is None:
            return self
        unit = self.units[number % len(self.units)]
        return replace(self, units=None, env={**self.env, "unit": unit})


@dataclass(frozen=True, kw_only=True)
class RolloutOptions(TaskOptions):
    """Rollouts of a policy in a task.

    Attributes:
        policy: Folder of a run, a checkpoint file, ``expert`` (scripted, reads the hidden state) or
            ``still`` (nothing moves).
        n: Number of episodes.
        cross_sensor: Whether the policy may have been trained on a different sensor.
        shown: Number of episodes on the page, failures and successes in turn.
        processes: Number of simulating processes; None for one per core.
        out: Folder of the results; None for runs/rollouts/TASK-SENSOR-POLICY. Stopped rollouts are
            resumed there, and a larger n adds to them.
    """

    policy: str
    n: int = 100
    cross_sensor: bool = False
    shown: int = 12
    processes: int | None = None
    out: str | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        if not 1 <= self.n <= PER_SEED:
            raise ConfigError(f"n={self.n}: give 1 to {PER_SEED} episodes")

    @property
    def folder(self) -> Path:
        """Folder of the results."""
        if self.out:
            return Path(self.out)
        words = f"{self.word}-{self.sensor}-{Path(self.policy).name}"
        return Path("runs") / "rollouts" / re.sub(r"[^\w.-]+", "_", words)


def make_environment(options: TaskOptions) -> Any:
    """Makes the gymnasium environment of a task, with episodes of limited length.

    Raises:
        ConfigError: There is no such task, or it does not accept a key.
    """
    import gymnasium

    name = environment_id(options.task)
    spec = gymnasium.spec(name)
    limit = options.limit or spec.max_episode_steps or LIMIT
    ours = {"steps": limit} if name.startswith(f"{NAMESPACE}/") else {}
    keys = {"sensor": options.sensor, "size": options.size, **ours, **options.env}
    try:
        return gymnasium.make(name, max_episode_steps=limit, disable_env_checker=True, **keys)
    except TypeError as error:
        raise ConfigError(f"task={options.task}: {error}; see env=") from error


def environment_id(task: str) -> str:
    """Gymnasium id of a task.

    Args:
        task: Name of a task of this package, or an id: ``tactileforge/Chip-v0``,
            ``module:Name-v0``, ``module:namespace/Name-v0``, or one that is registered.

    Raises:
        ConfigError: There is no such task; the message names the nearest.
    """
    import gymnasium

    try:
        module, _, name = task.rpartition(":")
        importlib.import_module(
            module or "tactileforge_policies.envs"
        )  # registers its environments
        if module or name in gymnasium.registry:
            gymnasium.spec(name)
            return name
    except (ImportError, gymnasium.error.Error) as error:
        raise ConfigError(f"task={task}: no such environment ({error})") from error
    ours = {
        name.partition("/")[2].removesuffix("-v0").lower(): name
        for name in gymnasium.registry
        if name.startswith(f"{NAMESPACE}/")
    }
    if task not in ours:
        raise ConfigError(unknown("task", task, ours, "One of yours: task=module:Name-v0"))
    return ours[task]
