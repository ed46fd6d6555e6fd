"""Chip: pick up a fragile chip, and set it down on a surface of unknown height."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from tactileforge_sim.geometry.indenter_geometry import pad, shape_of

from tactileforge_policies.envs.base import Advice, TouchEnv
from tactileforge_policies.envs.grip import Body
from tactileforge_policies.envs.outer import Array, Slot, Solid, ground
from tactileforge_policies.envs.picture import Picture

_RADIUS = 6.0
#: Points of the rim in contact with the floor, mm.
_RIM = _RADIUS * np.stack([np.sin([-0.4, 0.0, 0.4]), np.cos([-0.4, 0.0, 0.4])], 1)
#: Half width of a holder's floor, mm.
_STAND = 5.0
_NOWHERE = -60.0


def _ripples(x: Array, y: Array) -> Array:
    return np.asarray(0.075 * (1 - np.cos(2 * np.pi * x / 2.2)))


FACE = shape_of("chip", pad(_ripples, radius=_RADIUS, curve=40.0))


class Chip(TouchEnv):
    """Carries a chip from one holder to a second one with an invisible floor.

    The chip breaks if the fingers squeeze it with more than ``breaks`` N, if the floor pushes its
    edge with more than ``snaps`` N, or if it falls by more than 0.6 mm.
    """

    task = "chip"
    instruction = "pick up the chip without breaking it and set it down in the second holder"
    room: ClassVar[tuple[tuple[float, float], ...]] = ((-12.0, 40.0), (2.0, 30.0), (0.0, 12.0))

    def _draw(self, rng: np.random.Generator) -> tuple[Body, Array, Array]:
        low, high = self._fingers.friction
        self.drawn = d = {
            "thickness": rng.uniform(1.2, 2.6),
            "breaks": rng.uniform(2.0, 3.0),
            "snaps": rng.uniform(1.0, 1.5),
            "weight": rng.uniform(0.02, 0.05),
            "friction": rng.uniform(0.5 * (low + high), high),
            "holds": rng.uniform(0.3, 0.6),
            "to": rng.uniform(17.0, 21.0),
            "floor": rng.uniform(-1.5, 1.5),
        }
        self.floor = Solid(_RIM, ground(self._height), 2.0, 0.5)
        self.outer = [self.floor, Slot(self._holds, 10.0)]
        body = Body(FACE, d["thickness"] / 2, d["weight"], d["friction"])
        start = (rng.uniform(-3, 3), rng.uniform(9, 11), rng.uniform(4, 5.5))
        return body, np.array([0.0, -_RADIUS, 0.0]), np.array(start)

    def _height(self, x: Array) -> Array:
        there = np.abs(x - self.drawn["to"]) < _STAND
        return np.where(np.abs(x) < _STAND, 0.0, np.where(there, self.drawn["floor"], _NOWHERE))

    def _holds(self, place: Array) -> float:
        """Clamping force of the first holder on the chip's lower edge, N."""
        return self.drawn["holds"] if place[1] > -_RADIUS - 1.0 and abs(place[0]) < 3.0 else 0.0

    def _judge(self) -> None:
        d, x, lifted = self.drawn, self.object[0], -self.object[1] - _RADIUS
        at_goal = abs(x - d["to"]) < 2.5
        if self.held.normal > d["breaks"]:
            self.failure = "crushed"
        elif self.load(self.floor) > d["snaps"]:
            self.failure = "snapped"
        elif abs(self.held.pose[1]) > _RADIUS and not self.free:
            self.failure = "slipped"
        elif self.free:
            self.success = at_goal
        marks = (not self.free, lifted > 2.0, at_goal, self.success)
        self.score = max(self.score, *(0.25 * (i + 1) * m for i, m in enumerate(marks)))

    def _sketch(self, picture: Picture) -> None:
        x, z = float(self.object[0]), -float(self.object[1])
        picture.disc(x, z, _RADIUS, (232, 190, 92))
        picture.gripper(self.x, self.z)
        # The walls hide the lower edge of the chip, and with it the height of the floors.
        picture.box(0.0, -6.0, 11.0, 9.0, (150, 60, 50))
        picture.box(self.drawn["to"], -6.0, 11.0, 10.0, (50, 90, 150))

    def _advise(self) -> Advice:
        aside = float(np.clip(self.drawn["to"] - self.x, -1.5, 1.5))
        if abs(aside) < 1.0:
            return self._set_down(aside)
        if self.held.normal < 1.0 and self.object[1] > -_RADIUS - 0.5:
            return self._pick_up()
        up = float(np.clip(12.0 - self.z, -1.5, 1.5))
        return aside if self.z > 10.0 else 0.0, up, self.squeeze(1.2, 0.1, -0.1, 0.1)

    def _pick_up(self) -> Advice:
        x, z = -self.x, _RADIUS + 1.0 - self.z
        if np.hypot(x, z) > 1.0:
            return x, z, 0.0
        if self.held.normal < 0.02:
            return x, z, -0.3 if self.opening > 3.0 else -0.15
        return x, z, self.squeeze(1.4, 0.12, 0.04, 0.12)

    def _set_down(self, aside: float) -> Advice:
        load = self.load(self.floor)
        if load > 0.35 or self.held.normal < 0.8:
            return 0.0, 0.0, 0.3
        slowly = float(np.clip(0.5 * (self.z - 8.6), 0.2, 1.5))
        return aside, -0.1 if load > 0 else -slowly, self.squeeze(1.2, 0.1, -0.1, 0.1)
