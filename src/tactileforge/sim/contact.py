"""Normal contact: the pressure between a rigid object and the gel.

Pressure is nowhere negative; where it acts, surface and object touch; elsewhere the object does not
enter the gel. The constrained conjugate gradients are those of Polonsky and Keer, "A numerical
method for solving rough contact problems" (Wear 231, 1999), for a prescribed depth.
"""

from __future__ import annotations

import torch
from torch import Tensor

from tactileforge.errors import TactileForgeError
from tactileforge.sim.gel import Kernel

#: Largest misfit between surface and object in the contact, as a share of the depth.
TOLERANCE = 2e-3
_STEPS = 300


class NotConverged(TactileForgeError):
    """A contact that the solver did not settle; the message says which of the batch and how far."""


def press(
    kernel: Kernel, overlap: Tensor, start: Tensor | None = None, tolerance: float = TOLERANCE
) -> Tensor:
    """Pressure of rigid objects that overlap the undeformed gel.

    Args:
        kernel: The gel on its grid.
        overlap: float32 (B, n, n), mm by which the object would enter the gel if that did not
            yield; negative where it stays clear.
        start: A pressure to start from, such as that of the frame before.
        tolerance: Largest misfit in the contact, as a share of the depth.

    Returns:
        float32 (B, n, n), MPa.

    Raises:
        NotConverged: The misfit stays above the tolerance.
    """
    depth = overlap.amax((1, 2)).clamp(min=0)
    # Where it does not touch, the answer is 0, and needs no steps.
    limit = torch.where(depth > 0, tolerance * depth, torch.inf)
    touching = (depth > 0)[:, None, None]
    pressure = _first(kernel, overlap)
    if start is not None:
        kept = torch.where(overlap > 0, start, 0.0)
        pressure = torch.where((kept > 0).flatten(1).any(1)[:, None, None], kept, pressure)
    pressure = torch.where(touching, pressure, 0.0)
    misfit = kernel.press(pressure) - overlap
    direction = torch.zeros_like(pressure)
    before = torch.zeros_like(depth)
    for _ in range(_STEPS):
        active = pressure > 0
        residual = torch.where(active, misfit, 0.0)
        clear = torch.where(touching, misfit, 0.0)
        worst = torch.maximum(residual.abs().amax((1, 2)), (-clear).amax((1, 2)))
        if bool((worst <= limit).all()):
            return pressure
        square = _dot(residual, residual)
        share = torch.where(before > 0, square / before.clamp(min=1e-30), 0.0)
        direction = torch.where(active, residual + share[:, None, None] * direction, 0.0)
        yielding = kernel.press(direction)
        length = _dot(residual, direction) / _dot(direction, yielding).clamp(min=1e-30)
        stepped = (pressure - length[:, None, None] * direction).clamp(min=0)
        # Points that the object enters join the contact, and the directions start anew.
        joins = (stepped == 0) & (misfit < 0) & touching
        stepped = torch.where(joins, stepped - length[:, None, None] * misfit, stepped)
        stepped = stepped.clamp(min=0)
        changed = joins.flatten(1).any(1) | ((stepped == 0) & active).flatten(1).any(1)
        before = torch.where(changed, 0.0, square)
        pressure = stepped
        misfit = kernel.press(pressure) - overlap
    if start is not None:  # what is all but clear of the gel may be far from the frame before
        return press(kernel, overlap, None, tolerance)
    raise NotConverged(
        f"contact {int((worst / limit).argmax())} of {len(depth)} did not settle in {_STEPS} steps:"
        f" misfit {float((worst / depth.clamp(min=1e-9)).max()):.2g} of the depth"
    )


def _first(kernel: Kernel, overlap: Tensor) -> Tensor:
    """A first guess: a bed of springs as stiff as the gel under a patch of its thickness."""
    return overlap.clamp(min=0) / kernel.normal.max()


def _dot(left: Tensor, right: Tensor) -> Tensor:
    return (left * right).flatten(1).sum(1)
