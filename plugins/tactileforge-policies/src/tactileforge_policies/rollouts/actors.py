"""Actors of an episode: a trained policy, the scripted expert, or an idle one."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactileforge.errors import ConfigError
from tactileforge.plugins import sha256
from tactileforge_policies.rollouts.episode import Actor, Forces, Observation

#: Names of the actors without training.
SCRIPTED = ("expert", "still")


class Expert:
    """The scripted expert of the task, with access to its hidden state."""

    def reset(self, env: Any, seed: int) -> None:
        """Gets the expert of the environment."""
        self._act: Callable[[Observation], NDArray[np.float32]] = env.unwrapped.expert()

    def act(self, observation: Observation, force: Forces) -> NDArray[np.float32]:
        """Returns the expert's action."""
        return self._act(observation)


class Still:
    """An idle actor; nothing moves."""

    def reset(self, env: Any, seed: int) -> None:
        """Prepares a zero action of the right size."""
        self._still = np.zeros(env.action_space.shape, np.float32)

    def act(self, observation: Observation, force: Forces) -> NDArray[np.float32]:
        """Returns zeros."""
        return self._still


class PolicyActor:
    """A trained policy; its random numbers depend on the episode's seed alone.

    Args:
        policy: The policy, of `tactileforge_policies.load_policy`.
    """

    def __init__(self, policy: Any) -> None:
        self.policy = policy

    def reset(self, env: Any, seed: int) -> None:
        """Resets the policy, with pictures of the fingers at rest and in reference presses."""
        plain = env.unwrapped
        pressed = {"reference": plain.reference()} if self.policy.uses_reference else {}
        self.policy.reset(background=plain.background(), seed=seed, **pressed)

    def act(self, observation: Observation, force: Forces) -> NDArray[np.float32]:
        """Returns the policy's action."""
        touch = self.policy.fingers if self.policy.uses_touch else ()
        frames = {finger: observation[finger] for finger in touch}
        image = observation["image"] if self.policy.uses_image else None
        felt = dict(force) if self.policy.uses_force else None
        action: NDArray[np.float32] = self.policy.step(frames, observation["state"], image, felt)
        return action


def make_actor(word: str, env: Any, cross_sensor: bool = False) -> Actor:
    """Makes the actor for a word of the command line.

    Args:
        word: ``expert``, ``still``, the folder of a run, or a checkpoint file.
        env: Environment of the actor.
        cross_sensor: Whether the policy's sensor may differ from the environment's.

    Raises:
        ConfigError: Task, sensor, rate, fingers, or size of state or action of the policy do not
            match the environment.
    """
    if word == "expert":
        return Expert()
    if word == "still":
        return Still()
    from tactileforge_policies.policy import load_policy

    policy = load_policy(word)
    check_policy(word, policy, env, cross_sensor)
    return PolicyActor(policy)


def check_policy(word: str, policy: Any, env: Any, cross_sensor: bool) -> None:
    """Compares a policy with an environment, before anything is simulated.

    Raises:
        ConfigError: They do not match; the message names the difference and its fix.
    """
    plain = env.unwrapped
    wanted = {
        "fingers": (sorted(policy.fingers), sorted(plain.fingers)),
        "numbers of the state": (policy.state_size, env.observation_space["state"].shape[0]),
        "numbers of an action": (policy.action_size, env.action_space.shape[0]),
        "steps of a second": (round(float(policy.rate), 3), round(float(plain.control_rate), 3)),
    }
    for name, (ours, theirs) in wanted.items():
        if ours != theirs:
            raise ConfigError(
                f"policy={word} has {name}: {ours}, but task {plain.task} has {theirs}; train it "
                f"on demonstrations of this task (tactileforge demos task={plain.task} out=DIR)"
            )
    if policy.tasks and plain.task not in policy.tasks:
        raise ConfigError(
            f"policy={word} learned {', '.join(policy.tasks)}: give task={policy.tasks[0]}, or "
            f"train it on {plain.task} too (tactileforge demos task={plain.task} out=DIR)"
        )
    if policy.uses_reference and not hasattr(plain, "reference"):
        raise ConfigError(
            f"policy={word} was trained with reference presses, and task {plain.task} has no "
            "reference(); train it with data.reference_press=false"
        )
    sensors = [policy.sensor] if isinstance(policy.sensor, str) else list(policy.sensor)
    if policy.uses_touch and set(sensors) != {plain.sensor} and not cross_sensor:
        raise ConfigError(
            f"policy={word} was trained on {', '.join(dict.fromkeys(sensors))}; give sensor="
            f"{sensors[0]}, or cross_sensor=true to try it on {plain.sensor}"
        )


def fingerprint(word: str) -> str:
    """Hash of an actor's weights, against mixing results of different weights.

    Raises:
        ConfigError: There is no such policy.
    """
    if word in SCRIPTED:
        return word
    path = Path(word)
    if not path.exists():
        raise ConfigError(
            f"policy={word}: neither {' nor '.join(SCRIPTED)}, nor the folder of a run or a file"
        )
    from tactileforge.runs import BEST, LAST

    # The same choice of file as in `load_policy`.
    files = [path] if path.is_file() else [path / BEST, path / LAST]
    found = next((file for file in files if file.is_file()), None)
    if found is None:
        raise ConfigError(f"policy={word}: no weights there; train it first, to its end")
    return sha256(found)
