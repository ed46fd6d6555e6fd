"""Normal contact: the pressure between an object and the gel.

Pressure is nowhere negative; where it acts, surface and object touch; elsewhere the object does not
enter the gel. The constrained conjugate gradients are those of Polonsky and Keer, "A numerical
method for solving rough contact problems" (Wear 231, 1999), for a prescribed depth.
"""

from __future__ import annotations

import torch
from torch import Tensor

from tactileforge.errors import TactileForgeError
from tactileforge.sim.mechanics.gel import Kernel

#: Largest misfit between surface and object in the contact, as a share of the depth.
TOLERANCE = 2e-3
_STEPS = 300
#: Steps between two looks at whether all contacts have settled: a look waits for a GPU.
_LOOK = {"cpu": 1}
_RARELY = 8


class NotConverged(TactileForgeError):
    """A contact that the solver did not settle; the message says which of the batch and how far."""


def press(
    kernel: Kernel,
    overlap: Tensor,
    start: Tensor | None = None,
    tolerance: float = TOLERANCE,
    give: Tensor | None = None,
) -> Tensor:
    """Pressure of objects that overlap the undeformed gel.

    Each contact of the batch stops when it has settled: its pressure does not depend on the others.

    Args:
        kernel: The gel on its grid.
        overlap: float32 (B, n, n), mm by which the object would enter the gel if that did not
            yield; negative where it stays clear.
        start: A pressure to start from, such as that of the frame before.
        tolerance: Largest misfit in the contact, as a share of the depth.
        give: float32 (B,), mm/MPa by which the object itself yields where it is pressed, as a bed
            of springs; None for rigid objects.

    Returns:
        float32 (B, n, n), MPa.

    Raises:
        NotConverged: The misfit stays above the tolerance.
    """
    soft = None if give is None else give[:, None, None]
    pressure, misfit, settled = _settle(kernel, overlap, start, tolerance, soft)
    if bool(settled.all()):
        return pressure
    if start is not None:  # what is all but clear of the gel may be far from the frame before
        rest = ~settled
        softness = None if give is None else give[rest]
        pressure[rest] = press(kernel, overlap[rest], None, tolerance, softness)
        return pressure
    raise NotConverged(
        f"contact {int(misfit.argmax())} of {len(misfit)} did not settle in {_STEPS} steps:"
        f" misfit {float(misfit.max()):.2g} of the depth"
    )


def is_check_step(count: int, device: torch.device) -> bool:
    """Whether a loop asks at this step if it may stop."""
    return (count + 1) % _LOOK.get(device.type, _RARELY) == 0


def _settle(
    kernel: Kernel, overlap: Tensor, start: Tensor | None, tolerance: float, soft: Tensor | None
) -> tuple[Tensor, Tensor, Tensor]:
    """Pressure, misfit as a share of the depth (B,), and whether a contact has settled (B,)."""
    depth = overlap.amax((1, 2)).clamp(min=0)
    # Where it does not touch, the answer is 0, and needs no steps.
    limit = torch.where(depth > 0, tolerance * depth, torch.inf)
    touching = (depth > 0)[:, None, None]
    pressure = torch.where(touching, _first(kernel, overlap, start, soft), 0.0)
    misfit = _yielding(kernel, pressure, soft) - overlap
    direction = torch.zeros_like(pressure)
    before = torch.zeros_like(depth)
    for count in range(_STEPS):
        active = pressure > 0
        residual = torch.where(active, misfit, 0.0)
        clear = torch.where(touching, misfit, 0.0)
        worst = torch.maximum(residual.abs().amax((1, 2)), (-clear).amax((1, 2)))
        settled = worst <= limit
        if is_check_step(count, overlap.device) and bool(settled.all()):
            break
        square = _dot(residual, residual)
        share = torch.where(before > 0, square / before.clamp(min=1e-30), 0.0)
        direction = torch.where(active, residual + share[:, None, None] * direction, 0.0)
        yielding = _yielding(kernel, direction, soft)
        length = _dot(residual, direction) / _dot(direction, yielding).clamp(min=1e-30)
        stepped = (pressure - length[:, None, None] * direction).clamp(min=0)
        # Points that the object enters join the contact, and the directions start anew.
        joins = (stepped == 0) & (misfit < 0) & touching
        stepped = torch.where(joins, stepped - length[:, None, None] * misfit, stepped)
        stepped = stepped.clamp(min=0)
        changed = joins.flatten(1).any(1) | ((stepped == 0) & active).flatten(1).any(1)
        before = torch.where(changed, 0.0, square)
        pressure = torch.where(settled[:, None, None], pressure, stepped)
        misfit = _yielding(kernel, pressure, soft) - overlap
    return pressure, worst / depth.clamp(min=1e-9), settled


def _first(kernel: Kernel, overlap: Tensor, start: Tensor | None, soft: Tensor | None) -> Tensor:
    """A first guess: the start, or a bed of springs as stiff as the gel under a patch."""
    stiff = kernel.normal.max() if soft is None else kernel.normal.max() + soft
    guess = overlap.clamp(min=0) / stiff
    if start is None:
        return guess
    kept = torch.where(overlap > 0, start, 0.0)
    return torch.where((kept > 0).flatten(1).any(1)[:, None, None], kept, guess)


def _yielding(kernel: Kernel, pressure: Tensor, soft: Tensor | None) -> Tensor:
    """Displacement of gel and object together, mm."""
    depth = kernel.press(pressure)
    return depth if soft is None else depth + soft * pressure


def _dot(left: Tensor, right: Tensor) -> Tensor:
    return (left * right).flatten(1).sum(1)
