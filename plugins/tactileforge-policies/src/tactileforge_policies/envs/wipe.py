"""Wipe: draw an eraser once along a board of unknown height and slope."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from tactileforge_sim.geometry.indenter_geometry import pad, shape_of

from tactileforge_policies.envs.base import Advice, TouchEnv
from tactileforge_policies.envs.grip import Body
from tactileforge_policies.envs.outer import Array, Solid, ground
from tactileforge_policies.envs.picture import Picture

#: Distance from the middle of the eraser down to its felt, and half of the felt's length, mm.
_TALL, _HALF = 8.0, 4.0
_FELT = np.stack([np.linspace(-_HALF, _HALF, 5), np.full(5, _TALL)], 1)
#: First and last x of the ink, mm; it is counted in cells of 1 mm.
_FIRST, _LAST = 6, 32
#: Length of rubbing under enough load to clear a cell, mm.
_RUB = 4.0
#: Share of the ink to remove for success.
_CLEAN = 0.95


def _grooves(x: Array, y: Array) -> Array:
    return np.asarray(0.06 * (1 - np.cos(2 * np.pi * y / 2.4)))


FACE = shape_of("eraser", pad(_grooves, radius=5.0, curve=200.0))


class Wipe(TouchEnv):
    """Draws an eraser along an inked board, once and to the right.

    Ink is removed where the felt moves right under at least ``needs`` N; above ``stalls`` N the arm
    stalls. Height and slope of the board are invisible.
    """

    task = "wipe"
    instruction = "wipe the ink off the board in one pass to the right"
    room: ClassVar[tuple[tuple[float, float], ...]] = ((-12.0, 48.0), (2.0, 30.0), (0.0, 20.0))
    reach: ClassVar[tuple[float, float, float]] = (1.5, 1.0, 0.1)

    def _draw(self, rng: np.random.Generator) -> tuple[Body, Array, Array]:
        low, high = self._fingers.friction
        self.drawn = d = {
            "height": rng.uniform(-2.0, 2.0),
            "slope": rng.uniform(-0.06, 0.06),
            "drag": rng.uniform(0.2, 0.4),
            "needs": rng.uniform(0.7, 0.9),
            "stalls": rng.uniform(2.6, 3.0),
            "thickness": rng.uniform(10.0, 12.0),
            "squeeze": rng.uniform(0.3, 0.45),
            "friction": rng.uniform(0.5 * (low + high), high),
        }
        self.board = Solid(_FELT, ground(self._height), 0.5, d["drag"])
        self.outer = [self.board]
        self.ink = np.ones(_LAST - _FIRST)
        body = Body(FACE, d["thickness"] / 2, 0.1, d["friction"])
        x, z = rng.uniform(-5, -1), rng.uniform(12, 14)
        place = np.array([x + rng.uniform(-1, 1), -z + rng.uniform(-1, 1), 0.0])
        self._was = float(place[0])
        return body, place, np.array([x, z, d["thickness"] - 2 * d["squeeze"]])

    def _height(self, x: Array) -> Array:
        return np.asarray(self.drawn["height"] + self.drawn["slope"] * (x - 18.0))

    def _judge(self) -> None:
        d, x, before = self.drawn, float(self.object[0]), self._was
        self._was = x
        load = self.load(self.board)
        if self.free:
            self.failure = "dropped"
        elif load > d["stalls"]:
            self.failure = "stalled"
        elif load >= d["needs"] and x > before:
            self._rub(before, x)
        self.score = float(1 - self.ink.mean())
        if x > _LAST + _HALF and not self.failure:
            self.success = self.score >= _CLEAN
            self.failure = "" if self.success else "missed"

    def _rub(self, before: float, now: float) -> None:
        """Removes ink from the cells under the felt, for a motion from one x to another, mm."""
        cells = np.arange(_FIRST, _LAST) + 0.5
        way = np.clip(np.minimum(now, cells + _HALF) - np.maximum(before, cells - _HALF), 0, None)
        self.ink = np.clip(self.ink - way / _RUB, 0, 1)

    def _sketch(self, picture: Picture) -> None:
        x, z = float(self.object[0]), -float(self.object[1])
        picture.box(x, z - _TALL + 2, 2 * _HALF, 2 * _TALL - 2, (70, 110, 170))
        picture.box(x, z - _TALL, 2 * _HALF, 2.5, (40, 40, 44))
        picture.gripper(self.x, self.z)
        # A frame in front of the board hides its height.
        picture.box(18.0, -6.0, 60.0, 9.0, (205, 180, 140))
        for cell, left in enumerate(self.ink):
            shade = round(60 + 130 * (1 - float(left)))
            picture.box(_FIRST + cell + 0.5, -3.0, 1.0, 3.0, (shade, shade, shade))

    def _advise(self) -> Advice:
        load = self.load(self.board)
        if load == 0:
            return -0.5 * self.x, -float(np.clip(0.5 * (self.z - _TALL - 4.0), 0.3, 1.0)), 0.0
        along = 1.5 * float(np.clip((load - 0.8) / 0.4, 0.0, 1.0))
        return along, float(np.clip(0.3 * (load - 1.65), -0.25, 0.25)), 0.0
