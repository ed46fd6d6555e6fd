"""Motions of an object against a gel: its pose frame by frame, and the action labels."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tactileforge.contracts import ACTIONS
from tactileforge.errors import ConfigError, check_names, unknown

#: Phase of a path without an action: the object stays.
_STAY = "stay"
#: Direction of each action: x, y (of its length, mm), angle (of its turn, rad), depth.
_WAYS = {
    "press": (0, 0, 0, 1),
    "leave": (0, 0, 0, -1),
    "slide_left": (-1, 0, 0, 0),
    "slide_right": (1, 0, 0, 0),
    "slide_up": (0, -1, 0, 0),
    "slide_down": (0, 1, 0, 0),
    "rotate_cw": (0, 0, 1, 0),
    "rotate_ccw": (0, 0, -1, 0),
    _STAY: (0, 0, 0, 0),
}
#: Distance from the gel, mm, before a press and after a lift.
CLEAR = 0.05
#: The trials of the paper's force collection: press, slide forth and back, right and left, lift.
FORCE_TRIAL = ("press", "slide_up", "slide_down", "slide_left", "slide_right", "leave")


@dataclass(frozen=True)
class Sway:
    """Deviation from a path by an unsteady hand and an unlevel table.

    It grows with the depth of the path, and vanishes where the object is clear of the gel.

    Attributes:
        slope: float64 (2,), depth gained along x and y from the first touch, mm/mm.
        size: float64 (W, 6), amplitude of each wave in the units of a pose.
        hertz: float64 (W,), frequencies of the waves.
        phase: float64 (W, 6), phases of the waves, rad.
    """

    slope: NDArray[np.float64]
    size: NDArray[np.float64]
    hertz: NDArray[np.float64]
    phase: NDArray[np.float64]

    def __call__(
        self, times: NDArray[np.float64], moved: NDArray[np.float64], share: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Offsets (T, 6) of poses at times (T,), for motion since the start (T, 2), share (T,)."""
        angle = 2 * np.pi * self.hertz[:, None] * times[:, None, None] + self.phase
        added: NDArray[np.float64] = (self.size * np.sin(angle)).sum(1)
        added[:, 3] += moved @ self.slope
        return added * share[:, None]


@dataclass(frozen=True)
class Path:
    """Pose of an object at any time, smooth between knots.

    Attributes:
        times: float64 (K,), seconds, strictly increasing; the first is 0.
        poses: float64 (K, 6): x and y (mm, from the centre of the image, right and down), angle
            (rad, clockwise in the image), depth (mm beyond the first touch), tilt along x and
            along y (slope).
        actions: Names of the K - 1 phases' actions; ``stay`` for a phase without one.
        sway: Deviations of a hand from the path; None for a machine's exact path.
    """

    times: NDArray[np.float64]
    poses: NDArray[np.float64]
    actions: tuple[str, ...]
    sway: Sway | None = None

    @property
    def seconds(self) -> float:
        """Duration."""
        return float(self.times[-1])

    def pose(self, times: NDArray[np.float64]) -> NDArray[np.float64]:
        """Poses (T, 6) at times; constant before the start and after the end."""
        phase = self._phase(times)
        start, length = self.times[phase], np.diff(self.times)[phase]
        x = np.clip((times - start) / length, 0, 1)[:, None]
        before = self.poses[phase]
        out: NDArray[np.float64] = before + x * x * (3 - 2 * x) * (self.poses[phase + 1] - before)
        if self.sway is not None:
            share = np.clip(out[:, 3] / self.poses[:, 3].max(), 0, 1)
            out = out + self.sway(times, out[:, :2] - self.poses[0, :2], share)
        return out

    def action(self, times: NDArray[np.float64]) -> NDArray[np.int64]:
        """Actions (T,) at times, as indices into `ACTIONS`; -1 for none."""
        index = np.array([ACTIONS.index(a) if a in ACTIONS else -1 for a in self.actions])
        out = index[self._phase(times)]
        return np.where((times < 0) | (times > self.seconds), -1, out).astype(np.int64)

    def mirrored(self) -> Path:
        """The path with left and right swapped."""
        swap = {"slide_left": "slide_right", "rotate_cw": "rotate_ccw"}
        swap |= {new: old for old, new in swap.items()}
        sign = np.array([-1, 1, -1, 1, -1, 1])
        sway = self.sway and replace(
            self.sway, slope=self.sway.slope * sign[:2], size=self.sway.size * sign
        )
        actions = tuple(swap.get(a, a) for a in self.actions)
        return replace(self, poses=self.poses * sign, actions=actions, sway=sway)

    def _phase(self, times: NDArray[np.float64]) -> NDArray[np.intp]:
        segment = np.searchsorted(self.times, times, side="right") - 1
        return np.clip(segment, 0, len(self.actions) - 1)


@dataclass(frozen=True, kw_only=True)
class Speeds:
    """Sizes and speeds of a motion.

    Attributes:
        depth: Depth of a press, mm.
        slide: Length of a slide, mm.
        turn: Angle of a rotation, rad.
        seconds: Duration of one action, s.
        rest: Time without contact at the start and at the end, s.
    """

    depth: float = 0.8
    slide: float = 3.0
    turn: float = 0.35
    seconds: float = 0.8
    rest: float = 0.3


def chain(actions: Sequence[str], start: Sequence[float], speeds: Speeds) -> Path:
    """A path of actions, one after the other.

    Args:
        actions: Names in `ACTIONS`, or ``stay``; the path starts without contact, so ``press``
            comes first.
        start: x, y, angle, tilt along x, tilt along y of the first touch.
        speeds: Sizes and speeds.

    Raises:
        ConfigError: An action is unknown; the message lists the known ones.
    """
    size = np.array([speeds.slide, speeds.slide, speeds.turn, speeds.depth])
    x, y, angle, *tilt = start
    pose = np.array([x, y, angle, 0.0, *tilt])
    clear = pose - np.array([0, 0, 0, CLEAR, 0, 0])
    times, poses, phases = [0.0, speeds.rest], [clear, clear], [_STAY]
    check_names("action", actions, _WAYS)
    for action in actions:
        step = np.zeros(6)
        step[:4] = size * _WAYS[action]
        # A press starts from the clear, and a lift ends there.
        pose = clear + step if action == "press" and pose[3] <= 0 else pose + step
        if action == "press":
            pose[3] = speeds.depth
        if action == "leave":
            pose = pose.copy()
            pose[3] = clear[3]
        times.append(times[-1] + speeds.seconds)
        poses.append(pose)
        phases.append(action)
    if speeds.rest > 0:
        times.append(times[-1] + speeds.rest)
        poses.append(pose)
        phases.append(_STAY)
    first = 0 if speeds.rest > 0 else 1
    return Path(np.array(times[first:]), np.stack(poses[first:]), tuple(phases[first:]))


def atomic(action: str, start: Sequence[float], speeds: Speeds) -> Path:
    """A press, an action and a lift; slides and turns are centred on the start.

    ``press`` and ``leave`` are a press and a lift with a pause between.

    Raises:
        ConfigError: The action is unknown.
    """
    if action not in _WAYS:
        raise ConfigError(unknown("action", action, _WAYS))
    back = 0.5 * np.array(_WAYS[action][:3]) * (speeds.slide, speeds.slide, speeds.turn)
    if action in ("press", "leave"):
        return chain(("press", _STAY, "leave"), start, speeds)
    x, y, angle, *tilt = start
    moved = (x - back[0], y - back[1], angle - back[2], *tilt)
    return chain(("press", action, "leave"), moved, speeds)


def force_trial(start: Sequence[float], speeds: Speeds) -> Path:
    """The paper's force collection: press, slide in four directions, lift."""
    return chain(FORCE_TRIAL, start, speeds)


def manipulation(start: Sequence[float], speeds: Speeds, rng: np.random.Generator) -> Path:
    """A touch as in manipulation: random presses, slips, turns and tilts in six phases.

    Every motion has several components, so only its press and its lift are named actions.
    """
    x, y, angle, *tilt = start
    pose = np.array([x, y, angle, -CLEAR, *tilt])
    times, poses, phases = [0.0, max(speeds.rest, 1e-3)], [pose, pose], [_STAY]
    spread = np.array([speeds.slide / 2, speeds.slide / 2, speeds.turn, 0, 0.02, 0.02])
    for phase in ("press", _STAY, _STAY, _STAY, _STAY, "leave"):
        depth = -CLEAR if phase == "leave" else speeds.depth * rng.uniform(0.5, 1)
        target = np.array([x, y, angle, depth, *tilt]) + spread * rng.uniform(-1, 1, 6)
        if phase != _STAY:
            target[[0, 1, 2, 4, 5]] = poses[-1][[0, 1, 2, 4, 5]]
        times.append(times[-1] + speeds.seconds * rng.uniform(0.5, 1.5))
        poses.append(target)
        phases.append(phase)
    return Path(np.array(times), np.stack(poses), tuple(phases))


Motion = Callable[[Sequence[float], Speeds, np.random.Generator], Path]

#: Motions of a scene, by name.
MOTIONS: dict[str, Motion] = {
    **{a: lambda start, speeds, _, a=a: atomic(a, start, speeds) for a in ACTIONS},  # type: ignore[misc]
    "force_trial": lambda start, speeds, _: force_trial(start, speeds),
    "manipulation": manipulation,
}
