"""Four tasks for two fingers with touch sensors, as gymnasium environments.

Importing this package registers ``tactileforge/Chip-v0`` and the others.
"""

from __future__ import annotations

import gymnasium

from tactileforge.errors import ConfigError, unknown

#: Steps of the longest episode, 20 s.
STEPS = 120
#: Name of a task -> its class.
TASKS = {
    "chip": "Chip",
    "wipe": "Wipe",
    "grasp": "Grasp",
    "insert": "Insert",
}


def env_id(task: str) -> str:
    """Name of a task in gymnasium's registry.

    Raises:
        ConfigError: An unknown task; the message names the nearest.

    Example:
        >>> env_id("chip")
        'tactileforge/Chip-v0'
    """
    if task not in TASKS:
        raise ConfigError(unknown("task", task, TASKS))
    return f"tactileforge/{TASKS[task]}-v0"


for _task, _name in TASKS.items():
    gymnasium.register(
        env_id(_task),
        entry_point=f"tactileforge_policies.envs.{_task}:{_name}",
        max_episode_steps=STEPS,
    )
