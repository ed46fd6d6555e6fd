"""Forces of the world on a held object: contact with solids, and the hold of slots.

Places are in mm in the plane of the gels, x right and y down; angles turn x towards y. A solid is
elastic where points of the object enter it. Its Coulomb friction remembers where the points stuck.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

Array: TypeAlias = NDArray[np.float64]
#: Points (K, 2), mm -> depth of each inside the solid, mm (K,), and outward unit normals (K, 2).
Inside: TypeAlias = Callable[[Array], tuple[Array, Array]]


class Outer(Protocol):
    """A body of the world, with forces on some points of the object.

    Attributes:
        points: Points of the object, float64 (K, 2), mm in its frame.
    """

    points: Array

    def push(self, places: Array) -> tuple[Array, Array]:
        """Forces on points at places (K, 2): N (K, 2), and their derivatives, N/mm (K, 2, 2)."""
        ...

    def settle(self, places: Array) -> None:
        """Accepts places (K, 2) as the end of a step; friction continues from there."""
        ...


@dataclass
class Solid:
    """An elastic solid; points of the object may enter it a little.

    Attributes:
        points: Points of the object, float64 (K, 2), mm in its frame.
        inside: Depth and normals at points; see `Inside`.
        stiffness: Stiffness at each point, N/mm.
        friction: Coulomb's coefficient.
        anchors: Places (K, 2) of zero friction, mm; None before the first step.
    """

    points: Array
    inside: Inside
    stiffness: float
    friction: float
    anchors: Array | None = field(default=None, init=False)

    def push(self, places: Array) -> tuple[Array, Array]:
        """Elastic forces along normals, and friction along the surface; see `Outer.push`."""
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
        # Friction on a slipping point is proportional to its load, and so to its depth.
        mixed = np.where(slips, np.sign(drag) * self.friction * pressed, 0.0)
        sticks = np.where(slips | (depth <= 0), 0.0, -self.stiffness)
        slope = (
            pressed[:, None, None] * _outer(normal, normal)
            + mixed[:, None, None] * _outer(along, normal)
            + sticks[:, None, None] * _outer(along, along)
        )
        return force, slope

    def settle(self, places: Array) -> None:
        """Moves the anchors of slipped points; their friction stays at its bound."""
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
    """A slot with dry friction on the middle of the object.

    Attributes:
        holds: Largest force at a place, mm (2,) -> N; 0 outside of the slot.
        stiffness: Stiffness before it gives way, N/mm.
        points: Points of the object, float64 (1, 2), mm in its frame: its middle.
        anchor: Place (2,) of zero force, mm; None before the first step.
    """

    holds: Callable[[Array], float]
    stiffness: float
    points: Array = field(default_factory=lambda: np.zeros((1, 2)))
    anchor: Array | None = field(default=None, init=False)

    def push(self, places: Array) -> tuple[Array, Array]:
        """Force towards the anchor, limited by ``holds``; see `Outer.push`."""
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
        """Moves the anchor after a slip; see `Outer.settle`."""
        force, _ = self.push(places)
        self.anchor = places[0] + force[0] / self.stiffness


def ground(height: Callable[[Array], Array]) -> Inside:
    """The solid below a surface of small slopes, given by its ``height`` along x, mm above 0."""

    def inside(places: Array) -> tuple[Array, Array]:
        normal = np.zeros_like(places)
        normal[:, 1] = -1.0
        return places[:, 1] + height(places[:, 0]), normal

    return inside


def placed(points: Array, pose: Array) -> Array:
    """Transforms points (K, 2) of an object to the world, for a pose x, y (mm), angle (rad)."""
    cos, sin = np.cos(pose[2]), np.sin(pose[2])
    turn = np.array([[cos, sin], [-sin, cos]])
    return np.asarray(points @ turn + pose[:2])


def pushed(outer: list[Outer], pose: Array) -> tuple[Array, Array]:
    """Sums the forces of the world on an object at a pose.

    Args:
        outer: Bodies of the world around it.
        pose: x, y (mm) and angle (rad).

    Returns:
        Force and torque about its middle, (3,) N and N mm, and their derivatives by pose (3, 3).
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
        slope[2, 2] -= (arm * force).sum()  # the lever arms turn with the object
    return wrench, slope


def _outer(left: Array, right: Array) -> Array:
    return left[:, :, None] * right[:, None, :]
