"""Two gels, face to face, with one object between them.

The object is symmetric about the plane between the gels, and both gels yield alike: the contact of
the right finger is the mirror image of the left one's, so forces along the closing axis always
balance. In the plane, the object lies where the gels, its weight and the world balance each other.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from tactileforge_depth.gel import Gel
from tactileforge_sim.geometry.indenter_geometry import Shape
from tactileforge_sim.mechanics.touch import ContactSolver, ContactState, Tractions

from tactileforge_policies.envs.outer import Array, Outer, placed, pushed

#: The solver's grid: points a side, mm between them.
POINTS, SPACING = 36, 0.4
#: Largest residual force of a balanced object, N; torques are divided by `_ARM`, mm.
TOLERANCE = 0.01
_ARM = 4.0
_SCALE = np.array([1.0, 1.0, _ARM])
_STEPS, _HALVES = 40, 4
#: Longest step towards the equilibrium, mm.
_STRIDE = 0.5
#: Deepest indentation, mm; the fingers stop there.
DEEPEST = 1.2


@dataclass(frozen=True)
class Body:
    """An object to hold.

    Attributes:
        shape: Face towards the left gel; the other face is its mirror image.
        half: Distance from the middle plane to the lowest plane of a face, mm.
        weight: Weight, N.
        friction: Coulomb's coefficient on the gels.
        softness: Yield of each face under pressure, mm/MPa; 0 for a rigid object.
        centre: Centre of gravity from the middle, mm, right and down.
    """

    shape: Shape
    half: float
    weight: float
    friction: float
    softness: float = 0.0
    centre: tuple[float, float] = (0.0, 0.0)


@dataclass(frozen=True)
class Held:
    """One moment of a grip.

    Attributes:
        moment: Contact of the left gel.
        tractions: State of the solver.
        pose: Pose of the object: x, y (mm, down) and angle (rad), in the frame of the gripper.
        gels: Force and torque of both gels on the object, N and N mm (3,).
        outer: Force and torque of the world and of its weight on the object, N and N mm (3,).
        balanced: Whether the sum of both is below `TOLERANCE`.
    """

    moment: ContactState
    tractions: Tractions
    pose: Array
    gels: Array
    outer: Array
    balanced: bool

    @property
    def normal(self) -> float:
        """Force of each gel on the object along the closing axis, N."""
        return float(self.moment.force[0, 2])


class Grip:
    """Two gels around one object.

    Args:
        body: The object.
        gel: Gel of each finger, with the friction of the body.
        rate: Steps a second.
    """

    def __init__(self, body: Body, gel: Gel, rate: float) -> None:
        self.body = body
        heights = torch.from_numpy(body.shape.map(POINTS, SPACING))[None]
        soft = [body.softness] if body.softness else None
        self.solver = ContactSolver(heights, SPACING, [gel], [rate], softness=soft)
        self.gel = gel
        self.held = self.away()

    def away(self) -> Held:
        """Moment with the gels clear of the object."""
        return self._felt(self.solver.rest(), np.zeros(3), 2 * self.body.half + 20.0)

    def place(self, pose: Array, opening: float) -> None:
        """Places the object between the gels, without earlier shear.

        Args:
            pose: x, y (mm) and angle (rad) in the frame of the gripper.
            opening: Distance between the apexes of the gels, mm.
        """
        self.held = self._felt(self.solver.rest(), pose, opening)

    def narrowest(self) -> float:
        """Smallest opening, mm; the indentation is `DEEPEST` there."""
        return 2 * (self.body.half - DEEPEST)

    def close(self, opening: float, tool: Array, outer: Sequence[Outer]) -> Held:
        """Moves the gripper, and solves for the pose of the object.

        Newton's method on the sum of forces; the stiffness of the gels is guessed from the
        contact and corrected from step to step (Broyden, Math. Comp. 19, 1965).

        Args:
            opening: Distance between the apexes of the gels, mm.
            tool: x and y of the gripper in the world, mm.
            outer: Bodies of the world around the object.

        Returns:
            The moment. If it is not balanced, nothing holds the object.
        """
        before, base = self.held, np.array([*tool, 0.0])
        pose, step, halved = before.pose.copy(), np.zeros(3), 0
        best: tuple[Held, float] | None = None
        for _ in range(_STEPS):
            now, slope = self._met(self._felt(before.tractions, pose, opening), base, outer)
            miss = float(np.abs((now.gels + now.outer) / _SCALE).max())
            if miss < TOLERANCE or now.normal == 0:
                break
            if best is None:
                stiff = self._stiffness(now)
            else:
                stiff = _corrected(stiff, step, (now.gels - best[0].gels) / _SCALE)
            if best is None or miss < best[1] or halved == _HALVES:
                best, halved = (now, miss), 0
                step = _stride(stiff - slope / np.outer(_SCALE, _SCALE), now)
            else:  # the step was too long: a point met a body on the way, or began to slip
                step, halved = step / 2, halved + 1
            pose = best[0].pose + step / _SCALE
        self.held = replace(now, balanced=miss < TOLERANCE)
        for one in outer:
            one.settle(placed(one.points, base + self.held.pose))
        return self.held

    def _felt(self, before: Tractions, pose: Array, opening: float) -> Held:
        """Moment after a motion from ``before``; world and balance are not yet filled in."""
        depth = self.body.half - opening / 2
        six = torch.tensor([[*pose, depth, 0.0, 0.0]], dtype=torch.float32)
        tractions = self.solver.next(before, six)
        moment = self.solver.contact(tractions)
        # Forces in the plane add up with their mirror image on the right gel; hence the factor 2.
        gels = -2.0 * np.array([*moment.force[0, :2].tolist(), float(moment.torque[0])])
        return Held(moment, tractions, np.asarray(pose, float), gels, np.zeros(3), False)

    def _met(self, now: Held, base: Array, outer: Sequence[Outer]) -> tuple[Held, Array]:
        """Adds world and weight to a moment; also returns their derivative by pose (3, 3)."""
        wrench, slope = pushed(list(outer), base + now.pose)
        arm = placed(np.array([self.body.centre]), now.pose)[0] - now.pose[:2]
        weight = self.body.weight * np.array([0.0, 1.0, arm[0]])
        return replace(now, outer=wrench + weight), slope

    def _stiffness(self, now: Held) -> Array:
        """Estimates both gels' stiffness, N/mm (3, 3): a disc on a half-space plus on a layer."""
        area = float((now.tractions.pressure > 0).sum()) * SPACING**2
        radius, g = np.sqrt(area / np.pi), self.gel.shear_modulus
        shift = 8 * g * radius / (2 - self.gel.poisson) + g * area / self.gel.thickness
        turn = 16 / 3 * g * radius**3 + g * area * radius**2 / 2 / self.gel.thickness
        return 2.0 * np.diag([shift, shift, turn / _ARM**2])


def _corrected(stiff: Array, step: Array, change: Array) -> Array:
    """Broyden's update of the stiffness by a step (mm) and the resulting change of force (N)."""
    miss = -change - stiff @ step
    return np.asarray(stiff + np.outer(miss, step) / max(float(step @ step), 1e-12))


def _stride(stiff: Array, now: Held) -> Array:
    """Newton step towards balance, mm, at most `_STRIDE` long."""
    low = float(np.linalg.eigvalsh((stiff + stiff.T) / 2)[0])
    # If everything slips, nothing resists and the matrix is singular: it is made positive definite,
    # and the long step that follows is shortened below.
    firm = stiff + max(0.0, 0.02 - low) * np.eye(3)
    step = np.linalg.solve(firm, (now.gels + now.outer) / _SCALE)
    return np.asarray(step * min(1.0, _STRIDE / max(1e-9, float(np.abs(step).max()))))
