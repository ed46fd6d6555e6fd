"""Forces of the world on a held object: solids that it meets, and slots that hold it back.

Places are mm in the plane of the gels, x right and y down; angles turn x towards y. A solid is
elastic where points of the object enter it, with Coulomb friction that remembers where they stuck.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

Array: TypeAlias = NDArray[np.float64]
#: Points (K, 2), mm -> how deep each lies inside, mm (K,), and unit normals outwards (K, 2).
Inside: TypeAlias = Callable[[Array], tuple[Array, Array]]


class Outer(Protocol):
    """A body that pushes points which are fixed to the object.

    Attributes:
        points: float64 (K, 2), mm in the frame of the object.
    """

    points: Array

    def push(self, places: Array) -> tuple[Array, Array]:
        """Forces on points at places (K, 2): N (K, 2), and their derivatives, N/mm (K, 2, 2)."""
        ...

    def settle(self, places: Array) -> None:
        """Takes places (K, 2) as those of the step's end; friction starts from there."""
        ...


@dataclass
class Solid:
    """A solid that the object's points may enter a little.

    Attributes:
        points: float64 (K, 2), mm in the frame of the object.
        inside: Depth and normals at points.
        stiffness: N/mm of each point.
        friction: Coulomb's coefficient.
    """

    points: Array
    inside: Inside
    stiffness: float
    friction: float
    anchors: Array | None = field(default=None, init=False)

    def push(self, places: Array) -> tuple[Array, Array]:
        """See `Outer.push`."""
        depth, normal = self.inside(places)
        load = self.stiffness * np.maximum(depth, 0.0)
        along = np.stack([-normal[:, 1], normal[:, 0]], 1)
        anchors = places if self.anchors is None else self.anchors
        drag = -self.stiffness * ((places - anchors) * along).sum(1)
        bound = self.friction * load
        held = np.clip(drag, -bound, bound)
        force = load[:, None] * normal + held[:, None] * along
        pressed = np.where(depth > 0, -self.stiffness, 0.0)
        slips = np.abs(drag) > bound
        # A point that slips is dragged in proportion to its load.
        mixed = np.where(slips, np.sign(drag) * self.friction * pressed, 0.0)
        sticks = np.where(slips | (depth <= 0), 0.0, -self.stiffness)
        slope = (
            pressed[:, None, None] * _outer(normal, normal)
            + mixed[:, None, None] * _outer(along, normal)
            + sticks[:, None, None] * _outer(along, along)
        )
        return force, slope

    def settle(self, places: Array) -> None:
        """See `Outer.settle`: points that slipped stick anew, stretched by what friction bears."""
        force, _ = self.push(places)
        _, normal = self.inside(places)
        along = np.stack([-normal[:, 1], normal[:, 0]], 1)
        stretch = (force * along).sum(1) / self.stiffness
        self.anchors = places + stretch[:, None] * along

    def load(self, places: Array) -> float:
        """Sum of the normal forces at places (K, 2), N."""
        return float(self.stiffness * np.maximum(self.inside(places)[0], 0.0).sum())


@dataclass
class Slot:
    """A slot that holds the middle of the object back, as dry friction does.

    Attributes:
        holds: Largest force at a place, mm (2,) -> N; 0 outside of the slot.
        stiffness: N/mm before it gives way.
    """

    holds: Callable[[Array], float]
    stiffness: float
    points: Array = field(default_factory=lambda: np.zeros((1, 2)))
    anchor: Array | None = field(default=None, init=False)

    def push(self, places: Array) -> tuple[Array, Array]:
        """See `Outer.push`."""
        anchor = places[0] if self.anchor is None else self.anchor
        bound = self.holds(anchor)
        force = -self.stiffness * (places[0] - anchor)
        size = float(np.hypot(*force))
        if size <= bound:
            return force[None], -self.stiffness * np.eye(2)[None]
        way = force / size
        across = np.eye(2) - np.outer(way, way)
        return (bound * way)[None], -(bound / size * self.stiffness * across)[None]

    def settle(self, places: Array) -> None:
        """See `Outer.settle`."""
        force, _ = self.push(places)
        self.anchor = places[0] + force[0] / self.stiffness


def ground(height: Callable[[Array], Array]) -> Inside:
    """The solid below a surface: ``height`` gives mm above 0 along x; slopes must be small."""

    def inside(places: Array) -> tuple[Array, Array]:
        normal = np.zeros_like(places)
        normal[:, 1] = -1.0
        return places[:, 1] + height(places[:, 0]), normal

    return inside


def placed(points: Array, pose: Array) -> Array:
    """Places (K, 2) of points (K, 2) of an object at x, y (mm) and an angle (rad)."""
    cos, sin = np.cos(pose[2]), np.sin(pose[2])
    turn = np.array([[cos, sin], [-sin, cos]])
    return np.asarray(points @ turn + pose[:2])


def pushed(outer: list[Outer], pose: Array) -> tuple[Array, Array]:
    """Sums the forces of the world on an object at a pose.

    Args:
        outer: What pushes it.
        pose: x, y (mm) and angle (rad).

    Returns:
        Force and torque about its middle, (3,) N and N mm, and their derivatives (3, 3).
    """
    wrench, slope = np.zeros(3), np.zeros((3, 3))
    for one in outer:
        places = placed(one.points, pose)
        force, stiff = one.push(places)
        arm = places - pose[:2]
        moves = np.zeros((len(arm), 2, 3))
        moves[:, 0, 0] = moves[:, 1, 1] = 1.0
        moves[:, 0, 2], moves[:, 1, 2] = -arm[:, 1], arm[:, 0]
        wrench += np.einsum("kij,ki->j", moves, force)
        slope += np.einsum("kia,kij,kjb->ab", moves, stiff, moves)
        slope[2, 2] -= (arm * force).sum()  # arms turn with the object
    return wrench, slope


def _outer(left: Array, right: Array) -> Array:
    return left[:, :, None] * right[:, None, :]
