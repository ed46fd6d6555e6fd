"""One episode in closed loop: its observations, forces, actions and result."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from tactileforge.errors import TactileForgeError

Observation = Mapping[str, NDArray[Any]]
Forces = Mapping[str, NDArray[np.float32]]


class Actor(Protocol):
    """Chooser of actions: a policy, the scripted expert, or an idle one."""

    def reset(self, env: Any, seed: int) -> None:
        """Prepares for an episode, after the reset of its environment."""
        ...

    def act(self, observation: Observation, force: Forces) -> NDArray[np.float32]:
        """Chooses the action (A,) of a step.

        Args:
            observation: Observation of the environment.
            force: Force on each finger, (3,), N; privileged, for policies trained on it.
        """
        ...


@dataclass
class Episode:
    """An episode of T steps.

    Attributes:
        seed: Seed of its start and physics.
        rate: Steps a second, Hz.
        fingers: Names of the fingers.
        background: Picture of each untouched finger, uint8 (H, W, 3).
        observations: Observations, T + 1; the last is after the last action.
        forces: Forces on each finger, T + 1, (3,), N.
        actions: Chosen actions within the limits, without noise, T, float32 (A,).
        success: Whether the task was done.
        score: Score, 0 to 1, with partial credit.
        failure: Kind of failure; "" for success.
        seconds: Computing time of simulation and actor, s.
        act_seconds: Computing time of each action of the actor, s.
    """

    seed: int
    rate: float
    fingers: tuple[str, ...]
    background: Mapping[str, NDArray[np.uint8]]
    observations: list[Observation] = field(default_factory=list)
    forces: list[Forces] = field(default_factory=list)
    actions: list[NDArray[np.float32]] = field(default_factory=list)
    success: bool = False
    score: float = 0.0
    failure: str = ""
    seconds: float = 0.0
    act_seconds: list[float] = field(default_factory=list)

    @property
    def times(self) -> NDArray[np.float64]:
        """Times of the observations, s, (T + 1,)."""
        return np.arange(len(self.observations)) / self.rate

    def seen(self, name: str) -> NDArray[Any]:
        """Stacks one part of all observations, (T + 1, ...)."""
        return np.stack([observation[name] for observation in self.observations])

    def force_of(self, finger: str) -> NDArray[np.float32]:
        """Stacks the forces on a finger, (T + 1, 3), N."""
        return np.stack([forces[finger] for forces in self.forces])


def play_episode(env: Any, actor: Actor, seed: int, noise: float = 0.0) -> Episode:
    """Plays one episode to its end.

    Args:
        env: Environment with episodes of limited length; see `make_environment`.
        actor: Chooser of the actions.
        seed: Seed of start, physics and noise.
        noise: Standard deviation of the noise added to each action before it is carried out, as a
            share of the largest action.

    Raises:
        TactileForgeError: An action is not finite, or has the wrong size; the message names the
            step.
    """
    began = time.perf_counter()
    observation, _ = env.reset(seed=seed)
    plain = env.unwrapped
    backgrounds = {name: np.array(image) for name, image in plain.background().items()}
    episode = Episode(seed, float(plain.control_rate), tuple(plain.fingers), backgrounds)
    _observe(episode, plain, observation)
    actor.reset(env, seed)
    space, draw = env.action_space, np.random.default_rng(seed)
    ended = False
    while not ended:
        asked = time.perf_counter()
        action = np.asarray(actor.act(observation, episode.forces[-1]), np.float32)
        episode.act_seconds.append(time.perf_counter() - asked)
        _check_action(action, space.shape, episode)
        # An arm cannot exceed its limits, so larger commands are clipped; the noise comes after, as
        # the clipped command without noise is what a policy learns.
        action = np.clip(action, space.low, space.high)
        pushed = noise * space.high * draw.standard_normal(space.shape, np.float32)
        observation, _, terminated, truncated, info = env.step(
            np.clip(action + pushed, space.low, space.high)
        )
        episode.actions.append(action)
        _observe(episode, plain, observation)
        ended = bool(terminated or truncated)
    _end(episode, info, truncated=bool(truncated and not terminated))
    episode.seconds = time.perf_counter() - began
    return episode


def _observe(episode: Episode, env: Any, observation: Observation) -> None:
    episode.observations.append({name: np.array(part) for name, part in observation.items()})
    episode.forces.append({name: np.array(f, np.float32) for name, f in env.wrench().items()})


def _end(episode: Episode, info: Mapping[str, Any], truncated: bool) -> None:
    episode.success = bool(info["success"])
    episode.score = float(info["score"])
    kind = str(info.get("failure") or "") or ("timeout" if truncated else "failed")
    episode.failure = "" if episode.success else kind


def _check_action(action: NDArray[np.float32], shape: Sequence[int], episode: Episode) -> None:
    where = f"seed {episode.seed}, step {len(episode.actions)}"
    if action.shape != tuple(shape):
        raise TactileForgeError(
            f"{where}: an action of shape {action.shape}, but the task takes {tuple(shape)}; "
            "train the policy on demonstrations of this task"
        )
    if not np.isfinite(action).all():
        raise TactileForgeError(
            f"{where}: the action {action.tolist()} is not a number; the policy's training diverged"
        )
