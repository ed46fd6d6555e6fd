"""Tangential contact: shear traction under Coulomb friction, with sticking core and slipping rim.

Where shear q is below friction times pressure, mu p, the gel follows the object; where it has
reached that bound, the gel slips, and q points along the slip. The shear of the frame before is
kept: the path of the object matters.
"""

from __future__ import annotations

import torch
from tactileforge_depth.contact import NotConverged, is_check_step
from tactileforge_depth.gel import Kernel
from torch import Tensor

#: Largest misfit of sticking points, mm.
TOLERANCE = 1e-3
#: Largest number of steps before `NotConverged`.
_STEPS = 400
#: Axes of the components and points of a batch of tractions.
_AREA = (1, 2, 3)


def shear(
    kernel: Kernel,
    bound: Tensor,
    before: Tensor,
    motion: Tensor,
    start: Tensor | None = None,
    tolerance: float = TOLERANCE,
) -> Tensor:
    """Shear traction of the object on the gel after a small motion of the object.

    It minimises the convex energy f(q) = (q - q0) K (q - q0) / 2 - q d, where q0 is the shear
    before, K the gel's tangential compliance and d the object's motion, within the disc
    |q| <= mu p at every point, by projected gradients with the step lengths alpha of Barzilai and
    Borwein, "Two-point step size gradient methods" (IMA J. Numer. Anal. 8, 1988).

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
    inside = limit.sign()  # 1 in contact, 0 elsewhere
    now = limit_traction(before if start is None else start, limit)
    # The gradient g = K (q - q0) - d is the slip: gel minus object, 0 where they stick.
    slip = kernel.drag(now - before).sub_(motion).mul_(inside)
    alpha = (4 / kernel.tangent[0].max()).expand(len(now), 1, 1, 1)
    many = now.shape[0] > 1 or not is_check_step(0, now.device)
    for count in range(_STEPS):
        after = limit_traction(torch.addcmul(now, alpha, slip, value=-1), limit)
        dx = after - now
        # The projected gradient, mm: it vanishes where the gel sticks, and where slip pushes
        # against the bound.
        misfit = dx.abs().amax(_AREA) / alpha.view(-1)
        settled = misfit <= tolerance
        if is_check_step(count, now.device) and bool(settled.all()):
            return after
        slipped = kernel.drag(after - before).sub_(motion).mul_(inside)
        dg = slipped - slip
        dx_dg = _dot(dx, dg).clamp_(min=1e-20)
        # The short step <dx,dg>/<dg,dg> and the long one <dx,dx>/<dx,dg> in turn: the short one
        # damps stiff waves, the long one moves soft ones.
        step = _dot(dx, dx) / dx_dg if count % 2 else dx_dg / _dot(dg, dg).clamp_(min=1e-20)
        step = step.clamp_(1e-4, 1e4)[:, None, None, None]
        if many:  # a settled contact repeats its last step, whatever the others of the batch do
            kept = settled[:, None, None, None]
            step = torch.where(kept, alpha, step)
            after, slipped = torch.where(kept, now, after), torch.where(kept, slip, slipped)
        alpha, now, slip = step, after, slipped
    raise NotConverged(
        f"shear of contact {int(misfit.argmax())} of {len(now)} did not settle in {_STEPS} steps: "
        f"misfit {float(misfit.max()):.2g} mm"
    )


def limit_traction(traction: Tensor, limit: Tensor) -> Tensor:
    """Limits the length of a traction (B, 2, n, n) to a bound (B, 1, n, n)."""
    x, y = traction.unbind(1)
    size = torch.hypot(x, y).clamp_(min=1e-12)[:, None]
    return traction * torch.div(limit, size, out=size).clamp_(max=1)


def _dot(left: Tensor, right: Tensor) -> Tensor:
    return (left * right).sum(_AREA)
