"""An object moves against a gel: pressure, shear, force and torque, frame by frame.

Everything is solved in the frame of the object, which moves and turns with it: there the pressure
of a slide hardly changes from frame to frame, and what sticks to the object stands still.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from tactileforge.errors import ConfigError
from tactileforge.sim.mechanics import contact, friction
from tactileforge.sim.mechanics.gel import Gel, Kernel, kernel

#: Sizes of windows, in points, whose doubles have quick Fourier transforms.
_WINDOWS = (16, 20, 24, 30, 32, 36, 40, 48, 50, 54, 60, 64, 72, 80, 90, 96, 108, 128, 160, 192, 256)
#: Gel bulges around a contact, and ahead of what drags it; a window leaves this much room (mm) for
#: what might touch.
_ROOM = 0.08
#: Tolerance of the pressure that bounds the shear, before the pressure that answers to it.
_FIRST = 5 * contact.TOLERANCE


@dataclass(frozen=True)
class ContactState:
    """One moment of a batch of touches, in the frames of the objects.

    Attributes:
        pose: float32 (B, 6), see `motions.Path`.
        pressure: float32 (B, n, n), MPa.
        shear: float32 (B, 2, n, n), of the object on the gel, MPa.
        force: float32 (B, 3), of the object on the gel, N; x and y of the image, z into the gel.
        torque: float32 (B,), about the axis of the object, N mm, clockwise in the image.
        strain: float32 (B, 3, n, n), pressure and shear that deform the gel, over the modulus.
        depth: float32 (B,), mm that the lowest plane of the object lies beyond the gel's apex.
        bend: float32 (B,), 1/mm, the gel at rest lies ``bend`` times the squared distance from the
            centre of the image below its apex.
        give: float32 (B,), mm by which the object yields for a unit of ``strain``.
    """

    pose: Tensor
    pressure: Tensor
    shear: Tensor
    force: Tensor
    torque: Tensor
    strain: Tensor
    depth: Tensor
    bend: Tensor
    give: Tensor

    def overlap(self, x: Tensor, y: Tensor, heights: Tensor) -> Tensor:
        """Overlap of the objects with the undeformed gels, mm, (B, ...).

        Args:
            x: mm along the objects' own x, (B, ...).
            y: The same along y.
            heights: mm of the objects there above their lowest planes.
        """
        return _overlap(x, y, heights, self.pose, self.depth, self.bend)


def contacts(
    heights: Tensor,
    spacing: float,
    gels: Sequence[Gel],
    poses: Tensor,
    fps: Sequence[float],
    name: str = "touch",
    softness: Sequence[float] | None = None,
    window: int | None = None,
) -> Iterator[ContactState]:
    """Solves a batch of touches, in step; memory does not grow with the number of frames.

    Args:
        heights: float32 (B, n, n), mm of the objects above their lowest planes.
        spacing: mm between the points of these maps.
        gels: One of each touch; thickness and Poisson's ratio are the same for all.
        poses: float32 (B, T, 6), see `motions.Path`.
        fps: Frames per second of each touch.
        name: Name of the touch in errors.
        softness: mm/MPa by which each object yields where it is pressed; None for rigid ones.
        window: Points a side of the part of the grid that is solved; None takes the smallest that
            holds every contact of the batch.

    Yields:
        One `ContactState` a frame; its fields have the resolution of ``heights``.

    Raises:
        ConfigError: A depth beyond the gel, or gels of different thickness; says which.
        contact.NotConverged: The solver failed; nothing that is not a number leaves it.
    """
    _check(gels, poses, name)
    overlap = _Overlap(heights, spacing, gels, poses)
    window = overlap.window(poses) if window is None else window
    inner = overlap.cropped(window)
    # Tractions over the modulus: one kernel serves gels of any stiffness.
    unit = Gel(thickness=gels[0].thickness, poisson=gels[0].poisson, modulus=1.0)
    solver = kernel(unit, window, spacing, str(heights.device))
    modulus, mu, viscosity = (
        torch.tensor([float(getattr(g, key)) for g in gels], device=heights.device)
        for key in ("modulus", "friction", "viscosity")
    )
    rate = torch.tensor(list(fps), dtype=torch.float32, device=heights.device)
    give = modulus * torch.tensor(list(softness or [0.0] * len(gels)), device=heights.device)
    laws = _Laws(solver, mu, viscosity * rate, give if softness and any(softness) else None)
    state = _State.at_rest(len(gels), window, heights.device)
    try:
        for i in range(poses.shape[1]):
            state = state.next(laws, inner, poses[:, i])
            yield _contact(state, poses[:, i], inner, modulus, give, heights.shape[-1])
    except contact.NotConverged as error:
        raise contact.NotConverged(f"{name}, frame {i}: {error}") from None


@dataclass(frozen=True)
class _Laws:
    """Laws that a batch obeys: the gel, friction, viscosity in frames, and how objects yield."""

    solver: Kernel
    mu: Tensor
    viscosity: Tensor
    give: Tensor | None


@dataclass(frozen=True)
class _State:
    """State of a batch: tractions over the modulus, and the steps that led there."""

    pose: Tensor | None
    pressure: Tensor
    felt: Tensor
    shear: Tensor
    normal: Tensor

    @staticmethod
    def at_rest(batch: int, n: int, device: torch.device) -> _State:
        none = torch.zeros(batch, n, n, device=device)
        return _State(
            None, none, none, torch.zeros(batch, 2, n, n, device=device), none.sum((1, 2))
        )

    def next(self, laws: _Laws, overlap: _Overlap, pose: Tensor) -> _State:
        """Solves the next frame.

        Pressure and shear act on each other's displacements: pressure is solved over the surface
        that the shear of the frame before has tilted, shear with what pressure spreads, and then
        pressure once more.
        """
        solver = laws.solver
        old = pose if self.pose is None else self.pose
        entered = overlap(pose)
        # Fields are kept in the frames of the objects: a turn of the object turns the old shear.
        before = _rotated(self.shear, old[:, 2] - pose[:, 2])
        tilted = entered - solver.lift(before)
        pressure = contact.press(solver, tilted, self.pressure, _FIRST, laws.give)
        felt = self._felt(pressure, laws)
        if not bool((felt > 0).any()):
            return _State(pose, pressure, felt, torch.zeros_like(before), pressure.sum((1, 2)))
        # Pressure alone pushes the gel outwards: only the rest of the motion has to be sheared.
        motion = overlap.motion(old, pose) - solver.spread(pressure - self.pressure)
        shear = friction.shear(solver, laws.mu[:, None, None] * felt, before, motion)
        pressure = contact.press(solver, entered - solver.lift(shear), pressure, give=laws.give)
        felt = self._felt(pressure, laws)
        # The last pressure moved the bound |q| <= mu p, and Coulomb's law must hold in the result.
        shear = friction.limit_traction(shear, laws.mu[:, None, None, None] * felt[:, None])
        return _State(pose, pressure, felt, shear, pressure.sum((1, 2)))

    def _felt(self, pressure: Tensor, laws: _Laws) -> Tensor:
        """The pressure with its viscous part, which resists the change of the load."""
        # Kelvin-Voigt: p (1 + tau F'/F), where ``viscosity`` is tau in frames.
        normal = pressure.sum((1, 2))
        faster = (normal - self.normal) / normal.clamp(min=1e-12) * laws.viscosity
        return pressure * (1 + faster).clamp(min=0)[:, None, None]


class _Overlap:
    """Overlap of objects with undeformed gels, in the frames of the objects."""

    def __init__(self, heights: Tensor, spacing: float, gels: Sequence[Gel], poses: Tensor) -> None:
        n = heights.shape[-1]
        line = (torch.arange(n, device=heights.device) - (n - 1) / 2) * spacing
        self.y, self.x = torch.meshgrid(line, line, indexing="ij")
        self.heights, self.spacing = heights, spacing
        self.bend = torch.tensor(
            [0 if g.dome is None else 1 / (2 * g.dome) for g in gels], device=heights.device
        )
        self.first = torch.zeros(len(gels), device=heights.device)
        # Depth counts from the first touch at the first pose.
        self.first = self(poses[:, 0]).amax((1, 2)) - poses[:, 0, 3]

    def __call__(self, pose: Tensor) -> Tensor:
        """Overlap (B, n, n), mm, at poses (B, 6)."""
        return _overlap(self.x, self.y, self.heights, pose, self.depth(pose), self.bend)

    def depth(self, pose: Tensor) -> Tensor:
        """Depth of the lowest planes of the objects beyond the apex, mm (B,)."""
        return pose[:, 3] - self.first

    def motion(self, old: Tensor, new: Tensor) -> Tensor:
        """Motion (B, 2, n, n), mm, of the points of the objects, in their new frames."""
        before, now = (torch.stack(_placed(self.x, self.y, pose), 1) for pose in (old, new))
        return _rotated(now - before, -new[:, 2])

    def window(self, poses: Tensor) -> int:
        """Points of the smallest window that holds every contact."""
        near = torch.zeros_like(self.x, dtype=torch.bool)
        for i in range(poses.shape[1]):
            near |= (self(poses[:, i]) > -_ROOM).any(0)
        reach = torch.maximum(self.x.abs(), self.y.abs())[near]
        n = len(self.x)
        need = 2 * float(reach.max()) / self.spacing + 1 if len(reach) else 2.0
        return next((w for w in _WINDOWS if need <= w <= n and (n - w) % 2 == 0), n)

    def cropped(self, window: int) -> _Overlap:
        """The same laws on the middle ``window`` points a side."""
        edge = (len(self.x) - window) // 2
        middle = slice(edge, edge + window)
        out = object.__new__(_Overlap)
        out.x, out.y = self.x[middle, middle], self.y[middle, middle]
        out.heights, out.spacing = self.heights[:, middle, middle], self.spacing
        out.bend, out.first = self.bend, self.first
        return out


def _overlap(
    x: Tensor, y: Tensor, heights: Tensor, pose: Tensor, depth: Tensor, bend: Tensor
) -> Tensor:
    across, down = _placed(x, y, pose)
    tilt_x, tilt_y = pose[:, 4:, None, None].unbind(1)
    rest = bend[:, None, None] * (across**2 + down**2)
    return depth[:, None, None] - heights - tilt_x * x - tilt_y * y - rest


def _contact(
    state: _State,
    pose: Tensor,
    overlap: _Overlap,
    modulus: Tensor,
    give: Tensor,
    points: int,
) -> ContactState:
    area = overlap.spacing**2
    stiff = modulus[:, None, None]
    pressure, shear = state.felt * stiff, state.shear * stiff[:, None]
    pull = _rotated(shear.sum((2, 3))[..., None, None] * area, pose[:, 2])[..., 0, 0]
    twist = ((overlap.x * shear[:, 1] - overlap.y * shear[:, 0]) * area).sum((1, 2))
    edge = (points - pressure.shape[-1]) // 2
    strain = torch.cat([state.pressure[:, None], state.shear], 1)
    wide, wide_shear, strain = (
        torch.nn.functional.pad(field, (edge,) * 4) for field in (pressure, shear, strain)
    )
    force = torch.cat([pull, pressure.sum((1, 2))[:, None] * area], 1)
    return ContactState(
        pose,
        wide,
        wide_shear,
        force,
        twist,
        strain,
        overlap.depth(pose),
        overlap.bend,
        give,
    )


def _placed(x: Tensor, y: Tensor, pose: Tensor) -> tuple[Tensor, Tensor]:
    """Places in the image (mm) of points of objects."""
    left, top, angle = pose[:, :3, None, None].unbind(1)
    cos, sin = torch.cos(angle), torch.sin(angle)
    return left + cos * x - sin * y, top + sin * x + cos * y


def window(heights: Tensor, spacing: float, poses: Tensor, domes: Sequence[float | None]) -> int:
    """Points of the smallest window that holds every contact of an object, on any of these gels.

    Args:
        heights: float32 (n, n), mm of the object above its lowest plane.
        spacing: mm.
        poses: float32 (T, 6).
        domes: Radii of curvature of gels, mm.
    """
    gels = [Gel(dome=dome) for dome in domes]
    count = len(gels)
    many = poses.expand(count, -1, -1)
    return _Overlap(heights.expand(count, -1, -1), spacing, gels, many).window(many)


def _rotated(vectors: Tensor, angle: Tensor) -> Tensor:
    """Vectors (B, 2, ...) turned clockwise in the image."""
    cos, sin = (part[:, None, None] for part in (torch.cos(angle), torch.sin(angle)))
    x, y = vectors.unbind(1)
    return torch.stack([cos * x - sin * y, sin * x + cos * y], 1)


def _check(gels: Sequence[Gel], poses: Tensor, name: str) -> None:
    if len({(gel.thickness, gel.poisson) for gel in gels}) != 1:
        raise ConfigError(f"{name}: gels of one batch have one thickness and one Poisson's ratio")
    if not bool(torch.isfinite(poses).all()):
        raise ConfigError(f"{name}: a pose is not a finite number")
    deepest, thickness = float(poses[..., 3].max()), gels[0].thickness
    if deepest >= thickness:
        raise ConfigError(
            f"{name}: the object goes {deepest:.3g} mm deep, but the gel is {thickness:.3g} mm "
            "thick; press less"
        )
