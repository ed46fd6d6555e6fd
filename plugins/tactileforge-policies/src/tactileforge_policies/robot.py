"""Sizes of demonstrations, for building a policy; a run stores them as its facts."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any, Literal

from tactileforge.errors import ConfigError
from tactileforge.plugins import strict

#: Tracks of a demonstration: the proprioception before each command, float32 (T, S), and the
#: command, float32 (T, A).
STATE_TRACK, ACTIONS_TRACK = "state", "robot_action"


@dataclass(frozen=True, kw_only=True)
class Robot:
    """Sizes of demonstrations, for building a policy.

    Attributes:
        fingers: Names of the fingers, in their order in a batch.
        sensors: Type of the sensor of each finger.
        state_size: Numbers of the proprioception, S.
        action_size: Numbers of a command, A.
        rate: Commands a second, Hz.
        horizon: Commands of a chunk, H.
        observations: Number of steps with state (camera image, forces) in an observation, O.
        stride: Steps from one frame of a clip to the next.
        touch: Input of touch: ``frames``, ``force`` (N, privileged) or ``none``.
        image_size: Height and width of a camera image; 0 without a camera.
        reference_press: Whether changes of pictures are divided by the gain of their finger, see
            `reference.reference_gain`.
        tasks: Names of the tasks, from the label ``task``; empty where no demonstration has one.
    """

    fingers: tuple[str, ...]
    sensors: tuple[str, ...]
    state_size: int
    action_size: int
    rate: float
    horizon: int = 8
    observations: int = 2
    stride: int = 1
    touch: Literal["frames", "force", "none"] = "frames"
    image_size: int = 0
    reference_press: bool = False
    tasks: tuple[str, ...] = ()

    @classmethod
    def of(cls, facts: Mapping[str, Any]) -> Robot:
        """Reads the plain data of `facts`.

        Raises:
            ConfigError: They do not come from demonstrations.
        """
        if "action_size" not in facts:
            raise ConfigError("a policy learns from demonstrations: give data=demonstrations")
        return strict.build(cls, "facts", facts)

    @property
    def facts(self) -> dict[str, Any]:
        """These sizes as plain data."""
        return {k: list(v) if isinstance(v, tuple) else v for k, v in asdict(self).items()}
