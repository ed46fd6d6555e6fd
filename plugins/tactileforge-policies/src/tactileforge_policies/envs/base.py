"""Base of all tasks: a gripper with two touch sensors moves in a plane, step by step.

The simulation is quasi-static: after every step the held object lies where gels, weight and world
balance. Places are in mm, x to the right and z up; forces are in N. Observations contain no force.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable
from dataclasses import replace
from typing import Any, ClassVar, TypeAlias

import cv2
import gymnasium
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray
from tactileforge_depth.contact import NotConverged
from tactileforge_depth.gel import Gel
from tactileforge_sim.randomise.draw import Choice

from tactileforge.errors import ConfigError
from tactileforge_policies.envs.fingers import FINGERS, Fingers, mirrored
from tactileforge_policies.envs.grip import Body, Grip, Held
from tactileforge_policies.envs.outer import Array, Outer, Solid, placed
from tactileforge_policies.envs.picture import SIZE, Picture
from tactileforge_policies.envs.reference import reference_press

Observation: TypeAlias = dict[str, NDArray[Any]]
Action: TypeAlias = NDArray[np.float32]
#: Change of x, z and opening, mm.
Advice: TypeAlias = tuple[float, float, float]

#: Largest fall survived by any object, mm.
_DROP = 0.6


class TouchEnv(gymnasium.Env[Any, Any]):
    """A task for two fingers and one held object.

    Args:
        sensor: Type of both fingers' sensors, see `specs.published.SIMULATED`.
        size: Height and width of their frames, pixels.
        unit: Seed of the pair of sensors; a different unit stands for a swap of the gel pads.
        randomise: Differences between units, see `randomise.draw.randomised_rows`.
        steps: Steps without success after which the failure is ``timeout``; gymnasium's `TimeLimit`
            then ends the episode.
        render_mode: ``rgb_array`` or None.

    Attributes:
        drawn: Numbers drawn by the seed for this episode, by name; hidden from policies.

    Raises:
        ConfigError: The sensor is unknown, or the size too small.
    """

    task: ClassVar[str]
    instruction: ClassVar[str]
    fingers: ClassVar[tuple[str, ...]] = FINGERS
    action_names: ClassVar[tuple[str, ...]] = ("dx", "dz", "dopening")
    state_names: ClassVar[tuple[str, ...]] = ("x", "z", "opening")
    metadata: ClassVar[dict[str, Any]] = {  # type: ignore[misc]
        "render_modes": ["rgb_array"],
        "render_fps": 6,
        "units": {"state": "mm", "action": "mm per step"},
    }
    #: Largest motion of a step, mm.
    reach: ClassVar[tuple[float, float, float]] = (1.5, 1.5, 0.3)
    #: Lowest and highest x, z and opening, mm.
    room: ClassVar[tuple[tuple[float, float], ...]] = ((-20.0, 50.0), (0.0, 40.0), (0.0, 30.0))

    def __init__(
        self,
        sensor: str = "digit",
        size: int = 64,
        unit: int = 0,
        randomise: Choice = "unit",
        steps: int = 120,
        render_mode: str | None = None,
    ) -> None:
        if size < 16:
            raise ConfigError(f"envs: size is {size} pixels; give 16 or more")
        self.sensor, self.size, self.unit, self.control_rate = sensor, size, unit, 6.0
        self.render_mode, self.steps = render_mode, steps
        self._fingers = Fingers(sensor, unit, size, randomise)
        self._randomise, self._pressed = randomise, dict[str, NDArray[np.uint8]]()
        frame = spaces.Box(0, 255, (size, size, 3), np.uint8)
        low, high = (np.array(side, np.float32) for side in zip(*self.room, strict=True))
        seen: dict[str, spaces.Space[Any]] = {name: frame for name in FINGERS}
        seen["image"] = spaces.Box(0, 255, (SIZE, SIZE, 3), np.uint8)
        seen["state"] = spaces.Box(low, high, dtype=np.float32)
        self.observation_space = spaces.Dict(seen)
        reach = np.array(self.reach, np.float32)
        self._bounds = (-reach, reach)
        self.action_space = spaces.Box(*self._bounds, dtype=np.float32)
        self.drawn: dict[str, float] = {}
        self.outer: list[Outer] = []

    # To be defined by each task.

    @abstractmethod
    def _draw(self, rng: np.random.Generator) -> tuple[Body, Array, Array]:
        """Draws an episode: object, its pose (x, y down, angle), gripper's x, z and opening."""

    @abstractmethod
    def _judge(self) -> None:
        """Updates `score`, `success` and `failure` after a step."""

    @abstractmethod
    def _sketch(self, picture: Picture) -> None:
        """Draws the scene, without the gripper's arm."""

    @abstractmethod
    def _advise(self) -> Advice:
        """The expert's action, from the whole present state (privileged), without memory."""

    def _survives(self, drop: float) -> bool:
        """Whether the object survives a fall (mm) from its present place."""
        return drop <= _DROP

    def _view(self) -> Picture:
        return Picture(-20.0, -6.0, 60.0)

    # The environment.

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Begins an episode; equal seeds give byte-identical episodes."""
        super().reset(seed=seed, options=options)
        self.elapsed, self.score, self.success, self.failure = 0, 0.0, False, ""
        body, self.object, start = self._draw(self.np_random)
        self.tool, self.opening = np.array([start[0], -start[1]]), float(start[2])
        self.grip = Grip(body, self._gel(body), self.control_rate)
        self._fingers.meet(body.shape, int(self.np_random.integers(1 << 20)))
        for one in self.outer:
            one.settle(placed(one.points, self.object))
        self.grip.place(self._seen(), self.opening)
        self.free = self.held.normal == 0
        return self._observation(), self._info()

    def step(self, action: NDArray[Any]) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Moves the gripper; the reward is the gain in score.

        Raises:
            ConfigError: The action has the wrong shape, or a value that is not finite.
        """
        wanted = np.asarray(action, np.float64)
        if wanted.shape != self.action_space.shape or not np.isfinite(wanted).all():
            raise ConfigError(f"action={action}: give {self.action_space.shape} finite numbers")
        limited = np.clip(wanted, *self._bounds)
        before = self.score
        self.elapsed += 1
        self._move(limited)
        if not self.failure:
            self._judge()
        if self.elapsed >= self.steps and not (self.success or self.failure):
            self.failure = "timeout"
        done = bool(self.success or self.failure not in ("", "timeout"))
        return self._observation(), float(self.score - before), done, False, self._info()

    def render(self) -> NDArray[np.uint8]:
        """Draws left finger, third-person view and right finger in a row, uint8 (192, 576, 3)."""
        shown = self._shown
        tiles = [shown["left"], shown["image"], shown["right"]]
        return np.concatenate([_enlarged(tile, 192) for tile in tiles], 1)

    def background(self) -> dict[str, NDArray[np.uint8]]:
        """Frames of the gels without contact, uint8 (size, size, 3), by finger."""
        return {name: frame.copy() for name, frame in self._still.items()}

    def reference(self) -> dict[str, NDArray[np.uint8]]:
        """Frames of a reference press, uint8 (size, size, 3), by finger; see `reference_press`."""
        if not self._pressed:
            # Fingers of their own: the films of an episode do not depend on it.
            fingers = Fingers(self.sensor, self.unit, self.size, self._randomise)
            self._pressed = reference_press(fingers, self.control_rate)
        return {name: frame.copy() for name, frame in self._pressed.items()}

    def wrench(self) -> dict[str, NDArray[np.float32]]:
        """Force on each gel, N (3,): x and y of its picture, z into the gel; privileged."""
        moments = (self.held.moment, mirrored(self.held.moment))
        return {
            name: moment.force[0].numpy().copy()
            for name, moment in zip(FINGERS, moments, strict=True)
        }

    def expert(self) -> Callable[[Observation | None], Action]:
        """Scripted expert for the present episode, with knowledge hidden from policies."""

        def act(observation: Observation | None = None) -> Action:
            return np.clip(np.array(self._advise(), np.float32), *self._bounds)

        return act

    # For use by the tasks.

    @property
    def held(self) -> Held:
        """The last moment of the grip."""
        return self.grip.held

    @property
    def x(self) -> float:
        """Position x of the gripper, mm."""
        return float(self.tool[0])

    @property
    def z(self) -> float:
        """Height z of the gripper, mm."""
        return -float(self.tool[1])

    def load(self, solid: Solid) -> float:
        """Normal force of a solid on the object, N; 0 without contact."""
        return solid.load(placed(solid.points, self.object))

    def gap(self, solid: Solid) -> float:
        """Height of the object above a solid, mm."""
        return float(-solid.inside(placed(solid.points, self.object))[0].max())

    def squeeze(self, newton: float, gain: float, least: float, most: float) -> float:
        """Expert's change of opening towards a normal force, mm: ``gain`` in mm/N, within bounds.

        The opening shrinks by ``least`` to ``most`` mm.
        """
        return -float(np.clip(gain * (newton - self.held.normal), least, most))

    def _gel(self, body: Body) -> Gel:
        return replace(self._fingers.gel, friction=body.friction)

    def _seen(self) -> Array:
        """Pose of the object in the frame of the gripper."""
        return np.asarray(self.object - np.array([*self.tool, 0.0]))

    def _move(self, action: Array) -> None:
        goal = np.array([self.x, self.z, self.opening]) + action
        low, high = np.array(self.room).T
        x, z, opening = np.clip(goal, low, high)
        self.tool = np.array([x, -z])
        if self.free:
            self.grip.place(self._seen(), self.opening)
        self.opening = max(float(opening), self.grip.narrowest())
        try:
            held = self.grip.close(self.opening, self.tool, self.outer)
        except NotConverged:  # rare: this episode alone fails, and is marked as such
            self.failure = "unsolved"
            return
        if self.free and held.normal == 0:
            return
        self.object = held.pose + np.array([*self.tool, 0.0])
        # An object without balance falls, whether the fingers still touch it or not.
        self.free = held.normal == 0 or not held.balanced
        if self.free:
            self._fall()

    def _fall(self) -> None:
        """Lets the object fall onto the solid below it."""
        drop = min(self.gap(one) for one in self.outer if isinstance(one, Solid))
        if not self._survives(drop):
            self.failure = "dropped"
            return
        self.object = self.object + np.array([0.0, drop, 0.0])
        for one in self.outer:
            one.settle(placed(one.points, self.object))

    def _observation(self) -> Observation:
        if self.elapsed == 0:
            self._still = self._fingers.pictures(self.grip.away().moment)
        view = self._view()
        self._sketch(view)
        state = np.array([self.x, self.z, self.opening], np.float32)
        self._shown: Observation = {
            **self._fingers.pictures(self.held.moment),
            "image": view.taken(),
            "state": state,
        }
        return dict(self._shown)

    def _info(self) -> dict[str, Any]:
        return {
            "success": bool(self.success),
            "score": float(self.score),
            "failure": self.failure,
            "force": self.wrench(),
        }


def _enlarged(tile: NDArray[np.uint8], size: int) -> NDArray[np.uint8]:
    return np.asarray(cv2.resize(tile, (size, size), interpolation=cv2.INTER_NEAREST), np.uint8)
