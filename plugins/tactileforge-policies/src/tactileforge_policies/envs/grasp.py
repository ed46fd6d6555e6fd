"""Grasp: sort two kinds of balls of equal appearance into two boxes, uncrushed."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from tactileforge_sim.geometry.heightfields import bumps
from tactileforge_sim.geometry.indenter_geometry import DEEP, Shape, ball, shape_of

from tactileforge_policies.envs.base import Advice, TouchEnv
from tactileforge_policies.envs.grip import Body
from tactileforge_policies.envs.outer import Array, Solid, ground
from tactileforge_policies.envs.picture import Picture

_SEEN_RADIUS = 7.0
_STAND, _BOX = 5.0, 6.0
#: x of the boxes of soft and of hard balls, mm.
_BOXES = {True: -17.0, False: 17.0}


class Grasp(TouchEnv):
    """A ball lies between two boxes: soft, rough ones go to the left, hard, smooth ones right.

    A soft ball is crushed by more than ``breaks`` N. A hard one is heavy and slippery, and needs
    more than that. So the right force depends on the kind, which only touch reveals.
    """

    task = "grasp"
    instruction = "put the ball into its box: soft ones to the left, hard ones to the right"
    room: ClassVar[tuple[tuple[float, float], ...]] = ((-30.0, 30.0), (3.0, 34.0), (8.0, 26.0))

    def _draw(self, rng: np.random.Generator) -> tuple[Body, Array, Array]:
        low, high = self._fingers.friction
        self.soft = bool(rng.integers(2))
        radius = rng.uniform(6.6, 7.6)
        if self.soft:
            kind = {
                "weight": rng.uniform(0.15, 0.25),
                "friction": rng.uniform(0.5 * (low + high), high),
                "softness": rng.uniform(3.0, 6.0),
                "breaks": rng.uniform(1.5, 2.0),
            }
        else:
            kind = {
                "weight": rng.uniform(1.0, 1.2),
                "friction": rng.uniform(0.28, 0.34),
                "softness": 0.0,
                "breaks": rng.uniform(5.0, 6.0),
            }
        self.drawn = d = {"soft": float(self.soft), "radius": radius, **kind}
        rim = radius * np.stack([np.sin([-0.5, 0.0, 0.5]), np.cos([-0.5, 0.0, 0.5])], 1)
        self.floor = Solid(rim, ground(_height), 3.0, 0.5)
        self.outer = [self.floor]
        face = ball_face(radius, self.soft, int(rng.integers(1 << 31)))
        body = Body(face, radius, d["weight"], d["friction"], d["softness"])
        start = (rng.uniform(-2, 2), rng.uniform(10, 12), rng.uniform(16.5, 18))
        return body, np.array([rng.uniform(-1, 1), -radius, 0.0]), np.array(start)

    def _survives(self, drop: float) -> bool:
        return drop <= 0.6 or self._boxed() is not None

    def _boxed(self) -> bool | None:
        """Kind of the box around or below the ball (True for soft), or None."""
        for soft, x in _BOXES.items():
            if abs(float(self.object[0]) - x) < _BOX - 1.0:
                return soft
        return None

    def _judge(self) -> None:
        box, lifted = self._boxed(), -float(self.object[1]) - self.drawn["radius"]
        right = box is self.soft
        if self.held.normal > self.drawn["breaks"]:
            self.failure = "crushed"
        elif self.free and box is not None:
            self.success = right
            self.failure = "" if right else "wrong box"
        marks = (not self.free, lifted > 2.0, right, self.success)
        self.score = max(self.score, *(0.25 * (i + 1) * m for i, m in enumerate(marks)))

    def _sketch(self, picture: Picture) -> None:
        x, z = float(self.object[0]), -float(self.object[1])
        picture.disc(x, z, _SEEN_RADIUS, (196, 84, 78))
        picture.gripper(self.x, self.z)
        picture.box(0.0, -6.0, 2 * _STAND, 7.0, (120, 110, 100))
        for soft, box in _BOXES.items():
            picture.box(box, -6.0, 2 * _BOX, 10.0, (80, 130, 90) if soft else (70, 90, 150))

    def _view(self) -> Picture:
        return Picture(-32.0, -6.0, 64.0)

    def _advise(self) -> Advice:
        aside = float(np.clip(_BOXES[self.soft] - self.x, -1.5, 1.5))
        if abs(aside) < 1.5:
            return 0.0, 0.0, 0.3
        force = 1.0 if self.soft else 3.0
        stands = float(self.object[1]) > -self.drawn["radius"] - 0.5
        if stands and self.held.normal < 0.9 * force:
            return self._pick_up(force)
        up = float(np.clip(14.0 - self.z, -1.5, 1.5))
        return aside if self.z > 12.0 else 0.0, up, self.squeeze(force, 0.05, -0.1, 0.1)

    def _pick_up(self, force: float) -> Advice:
        x, z = float(self.object[0]) - self.x, self.drawn["radius"] + 0.5 - self.z
        if np.hypot(x, z) > 1.2:
            return x, z, 0.0
        if self.held.normal < 0.02:
            return x, z, -0.3 if self.opening > 15.4 else -0.15
        return 0.0, 0.0, self.squeeze(1.2 * force, 0.1, 0.04, 0.2)


def _height(x: Array) -> Array:
    """Height of the ground, mm: the stand, the floors of the boxes, and a gap between them."""
    boxed = np.min([np.abs(x - box) for box in _BOXES.values()], 0) < _BOX
    return np.where((np.abs(x) < _STAND) | boxed, 0.0, -60.0)


def ball_face(radius: float, rough: bool, seed: int) -> Shape:
    """Face of a ball.

    Args:
        radius: Radius, mm.
        rough: Whether bumps cover it.
        seed: Seed of the bumps.
    """
    round_ = ball(radius)
    if not rough:
        return shape_of("smooth ball", round_)
    grain = bumps(1.2, 0.12, seed)
    return shape_of("rough ball", lambda x, y: np.minimum(round_(x, y) + grain(x, y), DEEP))
