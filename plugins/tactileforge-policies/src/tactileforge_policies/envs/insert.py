"""Insert: move a plug from one socket to another of uncertain position."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from tactileforge_sim.geometry.indenter_geometry import extrude, join, lift, shape_of
from tactileforge_sim.geometry.sdf2d import box, cross

from tactileforge_policies.envs.base import Advice, TouchEnv
from tactileforge_policies.envs.grip import Body
from tactileforge_policies.envs.outer import Array, Inside, Slot, Solid, placed
from tactileforge_policies.envs.picture import Picture

#: Half width and length of the plug's tongue below the handle's middle; depth of a socket, mm.
_WIDE, LONG, _DEEP = 3.0, 13.0, 6.0
_SIDE = np.array([-8.0, -9.5, -11.0, -12.2])
#: Contact points on the tongue's outline, mm.
_TONGUE = np.array(
    [(side * _WIDE, -y) for side in (-1, 1) for y in _SIDE]
    + [(x, LONG) for x in (-_WIDE, -1.5, 0.0, 1.5, _WIDE)]
)
#: Chamfer of a socket's rim, and nominal x of the second socket, mm.
_CHAMFER, _NOMINAL = 0.2, 18.0

FACE = shape_of("plug", join(lift(extrude(box(8, 9)), 0.25), extrude(cross(6, 1.8))))


class Insert(TouchEnv):
    """Pulls a plug out of its socket and pushes it into a second one.

    The gap around the tongue is ``clearance`` mm in all. The second socket is up to 1.5 mm beside
    the place in the camera image. A tongue that meets its rim turns in the grip, to one side or the
    other. Above ``jams`` N the episode fails, as the socket would break.
    """

    task = "insert"
    instruction = "pull the plug out of the left socket and push it into the right one"
    room: ClassVar[tuple[tuple[float, float], ...]] = ((-8.0, 32.0), (4.0, 36.0), (2.0, 14.0))
    reach: ClassVar[tuple[float, float, float]] = (1.5, 1.0, 0.1)

    def _draw(self, rng: np.random.Generator) -> tuple[Body, Array, Array]:
        low, high = self._fingers.friction
        self.drawn = d = {
            "clearance": rng.uniform(0.1, 0.3),
            "beside": rng.uniform(-1.5, 1.5),
            "holds": rng.uniform(0.8, 1.5),
            "jams": rng.uniform(6.0, 7.0),
            "thickness": rng.uniform(5.0, 6.0),
            "squeeze": rng.uniform(0.4, 0.5),
            "friction": rng.uniform(0.5 * (low + high), high),
        }
        self.to = _NOMINAL + d["beside"]
        half = _WIDE + d["clearance"] / 2
        self.sockets = Solid(_TONGUE, sockets((0.0, self.to), half), 8.0, 0.15)
        self.outer = [self.sockets, Slot(self._holds, 20.0)]
        body = Body(FACE, d["thickness"] / 2, 0.1, d["friction"])
        place = np.array([0.0, _DEEP - LONG, 0.0])
        x, z = rng.uniform(-1, 1), LONG - _DEEP + rng.uniform(-1, 1)
        return body, place, np.array([x, z, d["thickness"] - 2 * d["squeeze"]])

    @property
    def depth(self) -> float:
        """Depth of the tongue's tip below the rims, mm; negative above."""
        return float(self.object[1]) + LONG

    def _holds(self, place: Array) -> float:
        """Force of the sockets' springs on the tongue, N, below a depth of 2 mm."""
        return self.drawn["holds"] if place[1] + LONG > 2.0 else 0.0

    def _judge(self) -> None:
        above = abs(float(self.object[0]) - self.to) < 3.0
        if self.load(self.sockets) > self.drawn["jams"]:
            self.failure = "jammed"
        elif self.free:
            self.failure = "dropped"
        elif abs(float(self.held.pose[2])) > 0.5 or np.abs(self.held.pose[:2]).max() > 5.0:
            self.failure = "slipped"
        self.success = not self.failure and above and self.depth > _DEEP - 0.4
        marks = (self.depth < -0.5, above, above and self.depth > 1.0, self.success)
        self.score = max(self.score, *(0.25 * (i + 1) * m for i, m in enumerate(marks)))

    def _sketch(self, picture: Picture) -> None:
        x, z = float(self.object[0]), -float(self.object[1])
        picture.box(x, z - LONG, 2 * _WIDE, LONG, (190, 192, 196))
        picture.box(x, z - 5.0, 9.0, 10.0, (50, 50, 54))
        picture.gripper(self.x, self.z)
        # Plates in front of the sockets hide their exact position.
        for at in (0.0, _NOMINAL):
            picture.box(at, -10.0, 14.0, 10.5, (120, 130, 150))

    def _view(self) -> Picture:
        return Picture(-18.0, -10.0, 58.0)

    def _advise(self) -> Advice:
        place, up = _NOMINAL - float(self.object[0]), LONG + 3.0
        if abs(place) > 2.5:
            out = self.depth < -0.5
            return float(np.clip(place, -1.5, 1.5)) if out else 0.0, up - self.z, 0.0
        load, depth = self.load(self.sockets), self.depth
        if depth > 1.0:
            return self._aside(0.1), -0.5, 0.0
        if load == 0:
            aside = self._aside(0.25) if depth > 0 else float(np.clip(place, -1.5, 1.5))
            return aside, -float(np.clip(0.5 * (self.z - 14.5), 0.25, 1.0)), 0.0
        return self._aside(0.25), float(np.clip(0.2 * (load - 1.2), -0.25, 0.25)), 0.0

    def _aside(self, pace: float) -> float:
        """Step along x of the tongue's tip towards the socket, mm, at most ``pace``."""
        tip = placed(np.array([[0.0, LONG]]), self.object)[0, 0]
        return float(np.clip(self.to - tip, -pace, pace))


def sockets(centres: tuple[float, float], half: float) -> Inside:
    """A block with its surface at 0 and two sockets in it.

    Args:
        centres: Positions x of the sockets, mm.
        half: Half of their width, mm.
    """

    def inside(places: Array) -> tuple[Array, Array]:
        x, below = places.T
        beside = np.stack([x - centre for centre in centres])
        beside = np.take_along_axis(beside, np.abs(beside).argmin(0)[None], 0)[0]
        towards = -np.sign(beside)
        wall = np.abs(beside) - half
        # The block beside a socket is convex: its surface, the wall and the chamfer between them.
        exits = np.stack([below, wall, (below + wall - _CHAMFER) / np.sqrt(2)])
        ways = np.stack(
            [
                np.stack([0 * x, -np.ones_like(x)], 1),
                np.stack([towards, 0 * x], 1),
                np.stack([towards, -np.ones_like(x)], 1) / np.sqrt(2),
            ]
        )
        nearest = exits.argmin(0)[None]
        depth = np.take_along_axis(exits, nearest, 0)[0]
        normal = np.take_along_axis(ways, nearest[..., None], 0)[0]
        floor = (wall < 0) & (below - _DEEP > depth)
        depth = np.where(floor, below - _DEEP, depth)
        return depth, np.where(floor[:, None], ways[0], normal)

    return inside
