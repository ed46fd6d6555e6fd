"""The reference press of a pair of fingers: a known ball, held with a known force."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from tactileforge_sim.geometry.indenter_geometry import ball, shape_of

from tactileforge_policies.envs.fingers import FINGERS, Fingers
from tactileforge_policies.envs.grip import DEEPEST, Body, Grip

#: Radius of the rigid ball, mm, and the force with which the gripper closes on it, N.
RADIUS, FORCE = 6.0, 2.0
BALL = shape_of("reference ball", ball(RADIUS))
#: Pictures averaged, against noise; halvings of the depth, to 0.1 um.
_PICTURES, _HALVINGS = 8, 14
_STILL = np.zeros(3)


def reference_press(fingers: Fingers, rate: float) -> dict[str, NDArray[np.uint8]]:
    """Pictures of both fingers in the reference press, uint8 (size, size, 3), by finger.

    A force, and not a travel, makes units of soft and of hard gels alike: the tasks are about
    forces.

    Args:
        fingers: The fingers; they begin a new film.
        rate: Steps a second.
    """
    body = Body(BALL, RADIUS, 0.0, fingers.gel.friction)
    grip = Grip(body, replace(fingers.gel, friction=fingers.friction[1]), rate)
    shallow, deep = 0.0, DEEPEST
    for _ in range(_HALVINGS):
        depth = (shallow + deep) / 2
        grip.place(_STILL, 2 * (RADIUS - depth))
        shallow, deep = (depth, deep) if grip.held.normal < FORCE else (shallow, depth)
    fingers.meet(BALL, 0)
    films = [fingers.pictures(grip.held.moment) for _ in range(_PICTURES)]
    return {
        name: np.rint(np.mean([film[name] for film in films], 0)).astype(np.uint8)
        for name in FINGERS
    }
