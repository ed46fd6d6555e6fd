"""Tangential contact: shear traction under Coulomb friction, with sticking core and slipping rim.

Where shear is below friction times pressure, the gel follows the object; where it has reached that
bound, the gel slips, and shear points along the slip. The shear of the frame before is kept: the
path of the object matters.
"""

from __future__ import annotations

import torch
from torch import Tensor

from tactileforge.sim.mechanics.contact import NotConverged, is_check_step
from tactileforge.sim.mechanics.gel import Kernel

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
    now = limit_traction(before if start is None else start, limit)
    slip = torch.where(inside, kernel.drag(now - before) - motion, 0.0)
    length = (4 / kernel.tangent[0].max()).expand(len(now), 1, 1, 1)
    for count in range(_STEPS):
        after = limit_traction(now - length * slip, limit)
        change = after - now
        misfit = (change.abs() / length).amax((1, 2, 3))
        settled = misfit <= tolerance
        if is_check_step(count, now.device) and bool(settled.all()):
            return after
        kept = settled[:, None, None, None]
        slipped = torch.where(inside, kernel.drag(after - before) - motion, 0.0)
        bend = slipped - slip
        mixed = _dot(change, bend).clamp(min=1e-20)
        # The long step and the short one in turn.
        step = mixed / _dot(bend, bend).clamp(min=1e-20)
        if count % 2:
            step = _dot(change, change) / mixed
        # What has settled repeats its last step, whatever the others do.
        length = torch.where(kept, length, step.clamp(1e-4, 1e4)[:, None, None, None])
        now, slip = torch.where(kept, now, after), torch.where(kept, slip, slipped)
    raise NotConverged(
        f"shear of contact {int(misfit.argmax())} of {len(now)} did not settle in {_STEPS} steps: "
        f"misfit {float(misfit.max()):.2g} mm"
    )


def limit_traction(traction: Tensor, limit: Tensor) -> Tensor:
    """Shortens a traction (B, 2, n, n) to a limit (B, 1, n, n) where it is longer."""
    x, y = traction.unbind(1)
    size = torch.hypot(x, y).clamp_(min=1e-12)[:, None]
    return traction * (limit / size).clamp_(max=1)


def _dot(left: Tensor, right: Tensor) -> Tensor:
    return (left * right).flatten(1).sum(1)
