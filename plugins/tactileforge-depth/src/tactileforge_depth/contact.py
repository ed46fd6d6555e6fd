"""Normal contact: the pressure between an object and the gel.

Pressure is nowhere negative; where it acts, surface and object touch; elsewhere the object does not
enter the gel. The constrained conjugate gradients are those of Polonsky and Keer, "A numerical
method for solving rough contact problems" (Wear 231, 1999), for a prescribed depth: the approach of
the bodies is known, so no mean is subtracted to balance a load. Letters as there: p is
the pressure, u = K p the displacement, g the gap, t the conjugate direction, r = K t, G the sum of
g^2 over the contact, tau the step length.
"""

from __future__ import annotations

import torch
from torch import Tensor

from tactileforge.errors import TactileForgeError
from tactileforge_depth.gel import Kernel

#: Largest misfit between surface and object in the contact, as a share of the depth.
TOLERANCE = 2e-3
#: Largest number of steps before `NotConverged`.
_STEPS = 300
#: Steps between two checks of convergence, by type of device; others check rarely, as reading the
#: result waits for the GPU.
_LOOK = {"cpu": 1}
_RARELY = 8
#: Axes of the points of a batch of fields.
_AREA = (1, 2)


class NotConverged(TactileForgeError):
    """No convergence of a contact; the message gives its place in the batch and its misfit."""


def press(
    kernel: Kernel,
    overlap: Tensor,
    start: Tensor | None = None,
    tolerance: float = TOLERANCE,
    give: Tensor | None = None,
) -> Tensor:
    """Pressure between objects and the gel, from their overlap with the undeformed gel.

    Each contact of the batch stops when it has settled: its pressure does not depend on the others.

    Args:
        kernel: The gel on its grid.
        overlap: float32 (B, n, n), depth of the object in an unyielding gel, mm; negative where it
            stays clear.
        start: Initial pressure, such as that of the frame before; None for a guess.
        tolerance: Largest misfit in the contact, as a share of the depth.
        give: float32 (B,), compliance of the object itself as a bed of springs, mm/MPa; None for
            rigid objects.

    Returns:
        float32 (B, n, n), MPa.

    Raises:
        NotConverged: The misfit stays above the tolerance.
    """
    soft = None if give is None else give[:, None, None]
    pressure, misfit, settled = _settle(kernel, overlap, start, tolerance, soft)
    if bool(settled.all()):
        return pressure
    if start is not None:  # near lift-off the frame before may be a bad start: start afresh
        rest = ~settled
        softness = None if give is None else give[rest]
        pressure[rest] = press(kernel, overlap[rest], None, tolerance, softness)
        return pressure
    raise NotConverged(
        f"contact {int(misfit.argmax())} of {len(misfit)} did not settle in {_STEPS} steps:"
        f" misfit {float(misfit.max()):.2g} of the depth"
    )


def is_check_step(count: int, device: torch.device) -> bool:
    """Whether a solver checks for convergence at this step."""
    return (count + 1) % _LOOK.get(device.type, _RARELY) == 0


def _settle(
    kernel: Kernel, overlap: Tensor, start: Tensor | None, tolerance: float, soft: Tensor | None
) -> tuple[Tensor, Tensor, Tensor]:
    """Pressure, misfit as a share of the depth (B,), and whether a contact has settled (B,)."""
    depth = overlap.amax(_AREA).clamp_(min=0)
    # An object clear of the gel has pressure 0: it is settled at once, whatever the tolerance.
    limit = torch.where(depth > 0, tolerance * depth, torch.inf)
    pressure = _first(kernel, overlap, start, soft).mul_(depth.sign()[:, None, None])
    gap = _yielding(kernel, pressure, soft).sub_(overlap)  # g: 0 in contact, > 0 where clear
    t = torch.zeros_like(pressure)
    # G of the step before; infinity restarts from steepest descent
    previous = torch.full_like(depth, torch.inf)
    active = pressure.sign()  # 1 in contact, 0 elsewhere
    looks = _LOOK.get(overlap.device.type, _RARELY)
    many = overlap.shape[0] > 1 or looks > 1
    for count in range(_STEPS):
        residual = gap * active
        worst = torch.maximum(residual.amax(_AREA), -gap.amin(_AREA))
        settled = worst <= limit
        if (count + 1) % looks == 0 and bool(settled.all()):
            break
        squares = _dot(residual, residual)  # G
        ratio = (squares / previous)[:, None, None]
        t = torch.addcmul(residual, ratio, t.mul_(active))  # g + delta G/G_old t
        r = _yielding(kernel, t, soft)
        tau = (_dot(residual, t) / _dot(t, r).clamp_(min=1e-30))[:, None, None]
        stepped = torch.addcmul(pressure, tau, t, value=-1).clamp_(min=0)
        # Free points that the object enters (I_ol) join the contact by a step along g. The old
        # direction is conjugate on the old contact only, so a changed contact drops it (delta = 0).
        entered = torch.addcmul(gap, gap, stepped.sign(), value=-1).clamp_(max=0)
        stepped.addcmul_(tau, entered, value=-1).clamp_(min=0)
        now = stepped.sign()
        changed = (now - active).abs_().sub_(entered).amax(_AREA) > 0
        previous = squares.masked_fill_(changed.logical_or(squares == 0), torch.inf)
        # On the same contact the gap follows from the step; else the gel is asked anew.
        follows = torch.addcmul(gap, tau, r, value=-1)
        if bool(changed.any()):
            anew = _yielding(kernel, stepped, soft).sub_(overlap)
            follows = torch.where(changed[:, None, None], anew, follows) if many else anew
        if many:  # a settled contact is frozen: its pressure must not depend on the others
            kept = settled[:, None, None]
            stepped, now = torch.where(kept, pressure, stepped), torch.where(kept, active, now)
            follows = torch.where(kept, gap, follows)
        pressure, active, gap = stepped, now, follows
    return pressure, worst / depth.clamp(min=1e-9), settled


def _first(kernel: Kernel, overlap: Tensor, start: Tensor | None, soft: Tensor | None) -> Tensor:
    """Initial guess: the start, or a bed of springs as stiff as the gel under a patch."""
    stiff = kernel.normal.max() if soft is None else kernel.normal.max() + soft
    guess = overlap.clamp(min=0) / stiff
    if start is None:
        return guess
    # Pressure of the frame before is kept only where there is still overlap: elsewhere it could
    # only be taken away again, step by step.
    kept = start * overlap.sign().clamp_(min=0)
    return torch.where(kept.amax(_AREA)[:, None, None] > 0, kept, guess)


def _yielding(kernel: Kernel, pressure: Tensor, soft: Tensor | None) -> Tensor:
    """Displacement of gel and object together, mm."""
    depth = kernel.press(pressure)
    return depth if soft is None else depth.add_(soft * pressure)


def _dot(left: Tensor, right: Tensor) -> Tensor:
    return (left * right).sum(_AREA)
