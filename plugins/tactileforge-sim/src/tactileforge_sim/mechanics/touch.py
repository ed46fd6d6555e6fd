"""Touches of objects on gels: pressure, shear, force and torque, frame by frame.

All fields are solved in the moving frame of the object: there the pressure of a slide hardly
changes from frame to frame, and gel that sticks to the object stands still.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import torch
from tactileforge_depth import contact
from tactileforge_depth.gel import Gel, kernel
from torch import Tensor

from tactileforge.errors import ConfigError
from tactileforge_sim.mechanics import friction
from tactileforge_sim.mechanics.overlap import Overlap, rotated

#: Tolerance of the first pressure of a step. It only bounds the shear, and is solved again after.
_FIRST = 5 * contact.TOLERANCE


@dataclass(frozen=True)
class ContactState:
    """One moment of a batch of touches, in the frames of the objects.

    Attributes:
        pose: float32 (B, 6), see `motions.Path`.
        pressure: float32 (B, n, n), pressure, MPa.
        shear: float32 (B, 2, n, n), shear traction of the object on the gel, MPa.
        force: float32 (B, 3), force of the object on the gel, N; x and y of the image, z into the
            gel.
        torque: float32 (B,), torque about the axis of the object, N mm, clockwise in the image.
        strain: float32 (B, 3, n, n), pressure and shear that deform the gel, over the modulus.
        depth: float32 (B,), depth of the object's lowest plane beyond the gel's apex, mm.
        bend: float32 (B,), dome of the gel, 1/mm: at rest it lies ``bend`` times the squared
            distance from the image's centre below its apex.
        give: float32 (B,), compliance of the object, mm per unit of ``strain``.
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


@torch.inference_mode()
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
    """Solves a batch of touches frame by frame; memory does not grow with their number.

    Args:
        heights: float32 (B, n, n), mm of the objects above their lowest planes.
        spacing: mm between the points of these maps.
        gels: Gel of each touch; thickness and Poisson's ratio are the same for all.
        poses: float32 (B, T, 6), see `motions.Path`.
        fps: Frames per second of each touch.
        name: Name of the touch in errors.
        softness: Compliance of each object, mm/MPa; None for rigid ones.
        window: Points a side of the solved part of the grid; None for the smallest part around
            every contact of the batch.

    Yields:
        One `ContactState` a frame; its fields have the resolution of ``heights``.

    Raises:
        ConfigError: A depth beyond the gel, gels of different thickness or Poisson's ratio, or a
            pose that is not finite; the message says so.
        contact.NotConverged: The solver failed; no NaN is yielded.
    """
    _check(gels, poses, name)
    solver = ContactSolver(heights, spacing, gels, fps, poses, softness, window)
    state = solver.rest()
    try:
        for i in range(poses.shape[1]):
            state = solver.next(state, poses[:, i])
            yield solver.contact(state)
    except contact.NotConverged as error:
        raise contact.NotConverged(f"{name}, frame {i}: {error}") from None


@dataclass(frozen=True)
class Tractions:
    """Tractions of a batch, over the modulus, in the solver's window, with their last pose.

    Attributes:
        pose: float32 (B, 6), pose of the last step; None before the first.
        pressure: float32 (B, w, w), elastic pressure.
        felt: float32 (B, w, w), pressure with its viscous part.
        shear: float32 (B, 2, w, w), shear in the frames of the objects.
        normal: float32 (B,), sums of ``pressure``.
    """

    pose: Tensor | None
    pressure: Tensor
    felt: Tensor
    shear: Tensor
    normal: Tensor


class ContactSolver:
    """Solves a batch of touches pose by pose.

    A step is a function of tractions and the next pose, without hidden state: it can be tried and
    discarded.

    Args:
        heights: float32 (B, n, n), mm of the objects above their lowest planes.
        spacing: mm between the points of these maps.
        gels: Gel of each touch; thickness and Poisson's ratio are the same for all.
        fps: Steps per second of each touch.
        poses: float32 (B, T, 6), see `motions.Path`: depth counts from the first touch at the
            first, and all lie within the window. None counts depth from the apex, and solves the
            full grid.
        softness: Compliance of each object, mm/MPa; None for rigid ones.
        window: Points a side of the solved part of the grid; None for the smallest part around
            every contact.
    """

    def __init__(
        self,
        heights: Tensor,
        spacing: float,
        gels: Sequence[Gel],
        fps: Sequence[float],
        poses: Tensor | None = None,
        softness: Sequence[float] | None = None,
        window: int | None = None,
    ) -> None:
        overlap = Overlap(heights, spacing, gels, poses)
        self.points = self.window = heights.shape[-1]
        if poses is not None:
            self.window = overlap.window(poses) if window is None else window
        self.overlap = overlap.cropped(self.window)
        # Tractions over the modulus: one kernel serves gels of any stiffness.
        unit = Gel(thickness=gels[0].thickness, poisson=gels[0].poisson, modulus=1.0)
        self.kernel = kernel(unit, self.window, spacing, str(heights.device))
        self.modulus, self.mu, viscosity = (
            torch.tensor([float(getattr(g, key)) for g in gels], device=heights.device)
            for key in ("modulus", "friction", "viscosity")
        )
        rate = torch.tensor(list(fps), dtype=torch.float32, device=heights.device)
        self.viscosity = viscosity * rate
        soft = torch.tensor(list(softness or [0.0] * len(gels)), device=heights.device)
        self.give = self.modulus * soft
        self.soft = self.give if softness and any(softness) else None

    def rest(self) -> Tractions:
        """Tractions of untouched gels."""
        none = torch.zeros(len(self.mu), self.window, self.window, device=self.mu.device)
        return Tractions(None, none, none, torch.stack([none, none], 1), none.sum((1, 2)))

    def next(self, state: Tractions, pose: Tensor) -> Tractions:
        """Solves the next frame.

        Pressure and shear displace the surface for each other: pressure is solved on the surface
        tilted by the shear of the frame before, then shear with the lateral spread of that
        pressure, and then pressure once more.

        Args:
            state: Tractions of the frame before.
            pose: float32 (B, 6), poses of the next frame.

        Raises:
            contact.NotConverged: The solver failed.
        """
        kernel = self.kernel
        old = pose if state.pose is None else state.pose
        entered = self.overlap(pose)
        if not bool((entered > 0).any() | state.pressure.any() | state.shear.any()):
            return replace(state, pose=pose, felt=state.pressure)  # clear of the gel, as before
        # Fields are kept in the frames of the objects: a turn of the object turns the old shear.
        before = rotated(state.shear, old[:, 2] - pose[:, 2])
        tilted = entered - kernel.lift(before)
        pressure = contact.press(kernel, tilted, state.pressure, _FIRST, self.soft)
        felt = self._felt(pressure, state.normal)
        # Pressure alone pushes the gel outwards: only the rest of the motion has to be sheared.
        motion = self.overlap.motion(old, pose) - kernel.spread(pressure - state.pressure)
        shear = friction.shear(kernel, self.mu[:, None, None] * felt, before, motion)
        pressure = contact.press(kernel, entered - kernel.lift(shear), pressure, give=self.soft)
        felt = self._felt(pressure, state.normal)
        # The last pressure moved the bound |q| <= mu p, and Coulomb's law must hold in the result.
        shear = friction.limit_traction(shear, self.mu[:, None, None, None] * felt[:, None])
        return Tractions(pose, pressure, felt, shear, pressure.sum((1, 2)))

    def _felt(self, pressure: Tensor, before: Tensor) -> Tensor:
        """The pressure with its viscous part, against the change of the load."""
        # Kelvin-Voigt: p (1 + tau F'/F), where ``viscosity`` is tau in frames.
        normal = pressure.sum((1, 2))
        faster = (normal - before) / normal.clamp(min=1e-12) * self.viscosity
        return pressure * (1 + faster).clamp(min=0)[:, None, None]

    def contact(self, state: Tractions) -> ContactState:
        """The `ContactState` of tractions; its fields have the resolution of the height maps."""
        assert state.pose is not None, "tractions at rest have no pose"
        area = self.overlap.spacing**2
        stiff = self.modulus[:, None, None]
        pressure, shear = state.felt * stiff, state.shear * stiff[:, None]
        pull = rotated(shear.sum((2, 3))[..., None, None] * area, state.pose[:, 2])[..., 0, 0]
        x, y = self.overlap.x, self.overlap.y
        twist = ((x * shear[:, 1] - y * shear[:, 0]) * area).sum((1, 2))
        edge = (self.points - pressure.shape[-1]) // 2
        strain = torch.cat([state.pressure[:, None], state.shear], 1)
        wide, wide_shear, strain = (
            torch.nn.functional.pad(field, (edge,) * 4) for field in (pressure, shear, strain)
        )
        force = torch.cat([pull, pressure.sum((1, 2))[:, None] * area], 1)
        depth, bend = self.overlap.depth(state.pose), self.overlap.bend
        return ContactState(
            state.pose, wide, wide_shear, force, twist, strain, depth, bend, self.give
        )


def window(heights: Tensor, spacing: float, poses: Tensor, domes: Sequence[float | None]) -> int:
    """Points a side of the smallest window around every contact of an object, on any of some gels.

    Args:
        heights: float32 (n, n), mm of the object above its lowest plane.
        spacing: Distance between the points of ``heights``, mm.
        poses: float32 (T, 6), poses of the object, see `motions.Path`.
        domes: Radii of curvature of gels, mm.
    """
    gels = [Gel(dome=dome) for dome in domes]
    count = len(gels)
    many = poses.expand(count, -1, -1)
    return Overlap(heights.expand(count, -1, -1), spacing, gels, many).window(many)


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
