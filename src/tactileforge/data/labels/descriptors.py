"""Descriptors of a touch: numbers that a classical method reads from its images, gel and forces."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import ClassVar

import torch
from torch import Tensor

from tactileforge.contracts import Batch
from tactileforge.data.labels import displacement

_QUANTILES = (0.01, 0.05, 0.25, 0.5, 0.75, 0.95, 0.99)
#: Edges of the rings of the spectrum, in cycles per pixel.
_RINGS = (0.0, 0.015, 0.03, 0.06, 0.12, 0.2, 0.3, 0.5)
#: Grey levels that count as 1.
_CONTRAST = 25.5
#: Depth from which the gel counts as touched, mm.
_TOUCHED = 0.006
#: Mean depth that a centre weighs as much as no contact, whose centre is the image's, mm.
_FAINT = 2e-5

#: Columns of image statistics, contact geometry and forces.
GROUPS = {"image": slice(0, 87), "contact": slice(87, 123), "force": slice(123, 129)}


@dataclass(frozen=True)
class Descriptors:
    """Descriptors of the clips of a batch: of their images, of the gel's surface, and forces.

    Forces are of the last frame and their change since the first, in units of the force scale.

    Attributes:
        values: float (B, COUNT), in the order of `GROUPS`.
        known: bool (B, COUNT).
    """

    COUNT: ClassVar[int] = 129
    values: Tensor
    known: Tensor

    @classmethod
    def of(cls, batch: Batch) -> Descriptors:
        """Descriptors of a batch; see `tactileforge.contracts`."""
        still = batch["background"][:, None].float()
        ends = (batch["frames"][:, [0, -1]].float() - still) / _CONTRAST
        force = batch["force"].nan_to_num() / batch["force_scale"][:, None]
        image, contact = image_descriptors(ends), contact_descriptors(batch["surface"])
        forces = torch.cat([force[:, -1], force[:, -1] - force[:, 0]], dim=1)
        known = [
            torch.ones_like(image, dtype=torch.bool),
            batch["surface_valid"][:, None].expand(contact.shape),
            batch["force_valid"].repeat(1, 2),
        ]
        return cls(torch.cat([image, contact, forces], dim=1), torch.cat(known, dim=1))


def image_descriptors(ends: Tensor) -> Tensor:
    """Statistics of the last frame, and energies of the changes.

    Args:
        ends: float (B, 2, 3, H, W), first and last frame of a clip less their background.

    Returns:
        (B, 87).
    """
    return torch.cat([frame_statistics(ends[:, -1]), motion_energy(ends)], dim=1)


def frame_statistics(frame: Tensor) -> Tensor:
    """Moments, quantiles, gradients, rings of the spectrum, and correlations of the colours.

    Args:
        frame: float (B, 3, H, W), less its background.

    Returns:
        (B, 69).
    """
    flat = frame.flatten(2)
    mean, spread = flat.mean(2), flat.std(2)
    unit = (flat - mean[..., None]) / spread[..., None].clamp(min=1e-6)
    edges = torch.tensor(_QUANTILES).to(frame.device, non_blocking=True)
    quantiles = flat.quantile(edges, dim=2).permute(1, 2, 0)
    steps = [frame.diff(dim=dim).flatten(2) for dim in (2, 3)]
    slopes = [part for step in steps for part in (step.abs().mean(2), step.std(2))]
    each = [mean, spread, unit.pow(3).mean(2), unit.pow(4).mean(2), *slopes]
    between = (unit[:, [0, 0, 1]] * unit[:, [1, 2, 2]]).mean(2)
    return torch.cat([*each, quantiles.flatten(1), spectrum_rings(frame).flatten(1), between], 1)


def motion_energy(ends: Tensor) -> Tensor:
    """Energy of the change from the background, and between the frames, of each channel.

    Args:
        ends: float (B, T, 3, H, W), frames less their background.

    Returns:
        (B, 18).
    """
    still = ends[:, -1] - ends[:, -1].median(dim=3, keepdim=True).values
    change = ends[:, -1] - ends[:, 0]
    parts = [part.flatten(2) for part in (ends[:, -1], still, change)]
    return torch.cat([s for p in parts for s in (p.abs().mean(2), p.square().mean(2))], 1)


def spectrum_rings(x: Tensor) -> Tensor:
    """Logarithm of the power in rings of the spectrum, (B, C, 7) of (B, C, H, W)."""
    power = torch.fft.fft2(x, norm="ortho").abs().square()
    across, down = (torch.fft.fftfreq(n, device=x.device) for n in (x.shape[3], x.shape[2]))
    radius = (across[None] ** 2 + down[:, None] ** 2).sqrt()
    inside = [(radius > low) & (radius <= high) for low, high in pairwise(_RINGS)]
    return (
        torch.stack([(power * ring).sum((2, 3)) / ring.sum().clamp(min=1) for ring in inside], 2)
        .add(1e-6)
        .log()
    )


def contact_descriptors(surface: Tensor) -> Tensor:
    """Contact geometry of the last frame, and its change since the first.

    Of each: centre of depth (x, y), its covariance (xx, yy, xy), mean and largest depth and their
    square roots, touched share of the surface, mean shear (x, y) and mean of its size, twist,
    spread, and mean slopes along x and y. Places are from -1 to 1 across the image, depths and
    shears in mm.

    Args:
        surface: uint8 (B, T, 3, H, W), coded displacements; see `displacement`.

    Returns:
        float (B, 36).
    """
    coded = displacement.coded_displacement(surface[:, [0, -1]])
    first, last = _contact(displacement.displacement_mm(coded)).unbind(1)
    return torch.cat([last, last - first], dim=1)


def _contact(moved: Tensor) -> Tensor:
    """(B, T, 18) of displacements in mm (B, T, 3, H, W)."""
    across, down, depth = moved.unbind(2)
    height, width = depth.shape[2:]
    x = torch.linspace(-1, 1, width, device=moved.device)
    y = torch.linspace(-1, 1, height, device=moved.device)[:, None]

    def mean(values: Tensor) -> Tensor:
        return values.mean((2, 3))

    dent = depth.clamp(min=0)
    total = mean(dent) + _FAINT
    centre_x, centre_y = mean(dent * x) / total, mean(dent * y) / total
    off_x, off_y = x - centre_x[..., None, None], y - centre_y[..., None, None]
    volume, deepest = mean(dent), dent.amax((2, 3))
    return torch.stack(
        [
            *(centre_x, centre_y),
            *(mean(dent * a * b) / total for a, b in _pairs(off_x, off_y)),
            *(volume, deepest, volume.sqrt(), deepest.sqrt()),
            mean((depth > _TOUCHED).float()),
            *(mean(across), mean(down), mean(across.abs()), mean(down.abs())),
            *(mean(down * x - across * y), mean(across * x + down * y)),
            *(mean(depth.diff(dim=dim).abs()) for dim in (3, 2)),
        ],
        dim=2,
    )


def _pairs(x: Tensor, y: Tensor) -> tuple[tuple[Tensor, Tensor], ...]:
    return (x, x), (y, y), (x, y)
