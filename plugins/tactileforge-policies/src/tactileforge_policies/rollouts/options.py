"""Options of a task, and its environment."""

from __future__ import annotations

import importlib
import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from tactileforge.data.frames.image_codecs import CODECS
from tactileforge.plugin import ConfigError, unknown

#: Namespace of the environments that come with the package.
NAMESPACE = "tactileforge"
#: Steps after which an episode of a task that has no limit of its own ends.
LIMIT = 500
#: First seed of demonstrations: no rollout is given one of theirs.
FIRST_DEMONSTRATION = 1_000_000_000
#: Episodes of one seed; another seed has others.
PER_SEED = 100_000


@dataclass(frozen=True, kw_only=True)
class TaskOptions:
    """A task, and how it is simulated.

    Attributes:
        task: ``grasp``, ``wipe``, ``insert`` or ``chip``; or the gymnasium id of an environment of
            yours, as ``module:Name-v0`` (docs/manipulation.md).
        sensor: Type of sensor of both fingers.
        size: Rows and columns of their pictures.
        seed: Another seed, other starts and physics.
        limit: Steps after which an episode ends; None for the limit of the task.
        env: Other keys of the environment, by name.
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
        """Seed of a rollout: the same start and physics for every policy.

        Example:
            >>> TaskOptions(task="chip", seed=2).episode_seed(7)
            200007
        """
        return self.seed * PER_SEED + number

    @property
    def word(self) -> str:
        """The task's name in keys and folders."""
        return self.task.rpartition(":")[2].rpartition("/")[2].removesuffix("-v0").lower()


@dataclass(frozen=True, kw_only=True)
class DemonstrationOptions(TaskOptions):
    """Demonstrations of the scripted expert, as shards that policies are trained on.

    Attributes:
        out: Folder of the shards.
        n: Episodes to keep; those in which the expert fails are left out and named.
        noise: Standard deviation of what is added to the expert's actions before they are carried
            out, as a share of the largest; what is written down is what it meant to do. So a
            policy sees how the expert comes back to its way (Laskey et al. 2017, DART).
        units: Units of the sensors, one an episode, in turns: policies see gels and lights that
            differ; None for the unit of ``env``.
        codec: How pictures are stored: without loss png or webp, or jpg (quality 95).
        processes: Processes that simulate; None for one a core.
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
        """Seed of a demonstration, which no rollout has.

        Example:
            >>> DemonstrationOptions(task="chip", out="x").episode_seed(7)
            1000000007
        """
        return FIRST_DEMONSTRATION + super().episode_seed(number)

    def of_unit(self, number: int) -> DemonstrationOptions:
        """Options whose environment has the unit of an episode."""
        if self.units is None:
            return self
        unit = self.units[number % len(self.units)]
        return replace(self, units=None, env={**self.env, "unit": unit})


@dataclass(frozen=True, kw_only=True)
class RolloutOptions(TaskOptions):
    """Rollouts of a policy in a task.

    Attributes:
        policy: Folder of a run, a file, ``expert`` (scripted, reads the hidden state) or ``still``
            (nothing moves).
        n: Episodes.
        cross_sensor: Whether the policy may have been trained on another sensor.
        shown: Episodes on the page, failures and successes in turn.
        processes: Processes that simulate; None for one a core.
        out: Folder of the results; None for runs/rollouts/TASK-SENSOR-POLICY. Rollouts that were
            stopped go on there, and a larger n adds to them.
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
    """The gymnasium environment of a task; its episodes end.

    Raises:
        ConfigError: There is no such task, or it does not take a key.
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
    """The gymnasium id of a task.

    Args:
        task: A word of ours, or an id: ``namespace/Name-v0``, ``module:Name-v0``.

    Raises:
        ConfigError: There is no such task; names the nearest.
    """
    import gymnasium

    try:
        module, _, name = task.rpartition(":")
        importlib.import_module(
            module or "tactileforge_policies.envs"
        )  # registers its environments
        if module:
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
