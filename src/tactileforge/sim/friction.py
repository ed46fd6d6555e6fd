"""Tangential contact: shear traction under Coulomb friction, with sticking core and slipping rim.

Where shear is below friction times pressure, the gel follows the object; where it has reached that
bound, the gel slips, and shear points along the slip. The shear of the frame before is kept: the
path of the object matters. Shear does not act back on the pressure (Goodman's assumption).
"""

from __future__ import annotations

import torch
from torch import Tensor

from tactileforge.sim.contact import NotConverged
from tactileforge.sim.gel import Kernel

#: Largest misfit of sticking points, mm.
TOLERANCE = 1e-3
_STEPS = 400


def shear(
    kernel: Kernel,
    bound: Tensor,
    before: Tensor,
    motion: Tensor,
    start: Tensor | None = None,
    tolerance: float = TOLERANCE,
) -> Tensor:
    """Shear traction of the object on the gel after a small motion of the object.

    It minimises a convex energy, within a disc at every point, by projected gradients with the step
    lengths of Barzilai and Borwein (IMA J. Numer. Anal. 8, 1988).

    Args:
        kernel: The gel on its grid.
        bound: float32 (B, n, n), friction times pressure, MPa.
        before: float32 (B, 2, n, n), shear of the frame before, x and y, MPa.
        motion: float32 (B, 2, n, n), motion of the object since then, mm.
        start: A shear to start from; the one before if not given.
        tolerance: Largest misfit of sticking points, mm.

    Returns:
        float32 (B, 2, n, n), MPa; its length is at most ``bound``.

    Raises:
        NotConverged: The misfit stays above the tolerance.
    """
    limit = bound[:, None]
    inside = limit > 0
    now = _within(before if start is None else start, limit)
    slip = torch.where(inside, kernel.drag(now - before) - motion, 0.0)
    length = torch.full((len(now), 1, 1, 1), 4 / float(kernel.tangent[0].max()), device=now.device)
    for count in range(_STEPS):
        after = _within(now - length * slip, limit)
        change = after - now
        misfit = (change.abs() / length).amax((1, 2, 3))
        if bool((misfit <= tolerance).all()):
            return after
        slipped = torch.where(inside, kernel.drag(after - before) - motion, 0.0)
        bend = slipped - slip
        mixed = _dot(change, bend).clamp(min=1e-20)
        # The long step and the short one in turn.
        step = mixed / _dot(bend, bend).clamp(min=1e-20)
        if count % 2:
            step = _dot(change, change) / mixed
        length = step.clamp(1e-4, 1e4)[:, None, None, None]
        now, slip = after, slipped
    raise NotConverged(
        f"shear of contact {int(misfit.argmax())} of {len(now)} did not settle in {_STEPS} steps: "
        f"misfit {float(misfit.max()):.2g} mm"
    )


def _within(traction: Tensor, limit: Tensor) -> Tensor:
    """The traction, shortened to the limit where it is longer."""
    size: Tensor = torch.linalg.vector_norm(traction, dim=1, keepdim=True)
    return traction * (limit / size.clamp(min=1e-12)).clamp(max=1)


def _dot(left: Tensor, right: Tensor) -> Tensor:
    return (left * right).flatten(1).sum(1)
