"""The gel's surface under a contact: its depth, and the displacement of its markers."""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from tactileforge_depth.gel import Gel, inverse_transform, kernel
from torch import Tensor
from torch.nn import functional as F

from tactileforge_sim.mechanics.touch import ContactState

#: Points of a fine height map for each point of the solver's.
DETAIL = 4
#: Smoothing of the solver's displacement: exp(-_BLUR) of its finest wave remains, and more of
#: longer ones. The edge of a contact lies between points of the grid: unsmoothed, it would ring.
_BLUR = 1.5


@dataclass(frozen=True)
class Fields:
    """Surfaces of a batch of moments, in the frames of the objects.

    Attributes:
        depth: float32 (B, 1, 4 n, 4 n), mm into the gel, twice as wide as the solver's grid.
        inside: float32 (B, 1, n, n), how far inside the contact a point lies, 0 to 1.
        strain: float32 (B, 1, n, n), pressure over the modulus, continued beyond the rim of the
            contact; None where objects are rigid.
    """

    depth: Tensor
    inside: Tensor
    strain: Tensor | None


class GelSurface:
    """Surfaces of a batch of touches, from the states of `touch.contacts`.

    The solver's displacement, which shear tilts as pressure dents it, is continued to twice the
    width of its grid, and smoothed. The object does not enter it: where its fine shape reaches
    deeper, the gel takes that shape. Well inside the contact the gel touches all of the object, and
    also takes its shape where it reaches less deep.

    Args:
        fine: float32 (1 or B, 4 n, 4 n), mm of the objects above their lowest planes.
        spacing: Distance between the points of the solver's grid, mm; four times that of ``fine``.
        gel: One of the gels; only its thickness and Poisson's ratio matter.
    """

    def __init__(self, fine: Tensor, spacing: float, gel: Gel) -> None:
        self.n, self.spacing = fine.shape[-1] // DETAIL, spacing
        self.poisson = gel.poisson
        unit = Gel(thickness=gel.thickness, poisson=gel.poisson, modulus=1.0)
        self.kernel = kernel(unit, self.n, spacing, str(fine.device))
        self.fine = fine[:, None]
        rows = torch.fft.fftfreq(2 * self.n, device=fine.device)[:, None]
        columns = torch.fft.rfftfreq(2 * self.n, device=fine.device)
        self.smooth = torch.exp(-_BLUR * 4 * (rows**2 + columns**2))

    def fields(self, contact: ContactState) -> Fields:
        """Fields of the surfaces at moments, for `picture`."""
        pressure, shear = contact.strain[:, :1], contact.strain[:, 1:]
        spectrum = self.kernel.normal * self._spectrum(pressure)
        spectrum = spectrum + self.kernel.lifted(self._spectrum(shear))[:, None]
        spectrum = spectrum * self.smooth
        n = self.n
        # Zeros at the high frequencies interpolate between the solver's points without bias.
        wide = torch.zeros(
            (*spectrum.shape[:2], 4 * n, 2 * n + 1), dtype=spectrum.dtype, device=spectrum.device
        )
        wide[..., :n, :n], wide[..., -n:, :n] = spectrum[..., :n, :n], spectrum[..., -n:, :n]
        depth = 4 * inverse_transform(wide)
        # 0 at the rim, 1 where all neighbours touch: at the rim the solver's points cannot tell
        # contact from gap, so there the object only pushes the gel, and never pulls it up.
        inside = F.avg_pool2d((pressure > 0).float(), 3, 1, 1)
        soft = _continued(pressure) if bool((contact.give > 0).any()) else None
        return Fields(depth, (3 * inside - 2).clamp(min=0), soft)

    def picture(self, fields: Fields, contact: ContactState, places: Tensor) -> Tensor:
        """The depth of the surface at places of images.

        Args:
            fields: Fields of the moments, see `fields`.
            contact: The moments.
            places: float32 (H, W, 2), x and y of the pixels, mm from the centre.

        Returns:
            float32 (B, H, W), mm into the gel, from its surface at rest.
        """
        # Frame by frame: what belongs to one fits a processor's cache.
        x, y = (part.contiguous() for part in places.unbind(-1))
        spots, far = torch.view_as_complex(places), x.square().addcmul_(y, y)
        out = places.new_empty(len(contact.pose), *places.shape[:2])
        for frame, depth in enumerate(out):
            turn, shift, plane, high = _affine(contact, frame)
            reach = (x * plane[0]).addcmul_(y, plane[1]).addcmul_(far, plane[2]).add_(high)
            depth.copy_(self._frame(fields, contact, frame, spots * turn + shift, reach))
        return out

    def _frame(
        self, fields: Fields, contact: ContactState, frame: int, spots: Tensor, reach: Tensor
    ) -> Tensor:
        """One frame of `picture`, (H, W).

        Args:
            fields: Fields of the moments.
            contact: The moments.
            frame: Number of the moment.
            spots: complex64 (H, W), places of the pixels in the object's frame, mm.
            reach: float32 (H, W), overlap of the object's lowest plane with the gel, mm.
        """
        n, here = self.n, slice(frame, frame + 1)
        there = torch.view_as_real(spots.mul_(2 / (n * self.spacing)))[None]
        # Points lie at the centres of cells; the solver's grid sits in the middle of the wide one,
        # whose points are those of the grid and one between each two of them.
        wide = (there / 2).sub_(0.25 / n)
        depth = F.grid_sample(fields.depth[here], wide, align_corners=False)[0, 0]
        fine = self.fine if len(self.fine) == 1 else self.fine[here]
        more = reach.sub_(_sample(fine, there, "border")[0])
        if fields.strain is not None:
            more -= contact.give[frame] * _sample(fields.strain[here], there)[0]
        more -= depth
        x, y = there[0].abs().unbind(-1)
        more *= torch.maximum(x, y) < 1
        # The share of the finest shape of a soft object that the gel takes; 1 for a rigid one. A
        # wave q on a bed of springs of compliance g presses the gel against its stiffness
        # k = q / (2 (1 - nu^2)) over the modulus: the gel takes 1 / (1 + g k) of it.
        stiff = math.pi / self.spacing / (2 * (1 - self.poisson**2))
        more *= 1 / (1 + stiff * contact.give[frame])
        inside = _sample(fields.inside[here], there)[0]
        return depth.add_(more.clamp(min=0)).addcmul_(more.clamp_(max=0), inside)

    def lateral(self, contact: ContactState, places: Tensor) -> Tensor:
        """Lateral displacement of points of the surface.

        Args:
            contact: The moment.
            places: float32 (B, M, 2), x and y at rest, mm from the centre of the image.

        Returns:
            float32 (B, M, 2), mm along x and y of the image.
        """
        pressure, shear = contact.strain[:, :1], contact.strain[:, 1:]
        moved = self.kernel.dragged(self._spectrum(shear))
        moved = moved + 1j * self.kernel.coupling * self._spectrum(pressure)
        n = self.n
        field = inverse_transform(moved)
        # The field is in the frame of the object; markers lie and move in that of the image.
        x, y = places.unbind(-1)
        left, top, angle = contact.pose[:, :3, None].unbind(1)
        x, y = x - left, y - top
        cos, sin = torch.cos(angle), torch.sin(angle)
        there = torch.stack([cos * x + sin * y, cos * y - sin * x], -1)[:, None] / self.spacing
        out = F.grid_sample(field, there / n, align_corners=False)[:, :, 0]
        x, y = out.unbind(1)
        return torch.stack([cos * x - sin * y, sin * x + cos * y], -1)

    def _spectrum(self, field: Tensor) -> Tensor:
        """Fourier transform of a field, centred on a zero-padded grid of twice its width."""
        edge = self.n // 2
        out: Tensor = torch.fft.rfft2(F.pad(field, (edge,) * 4))
        return out


def _continued(pressure: Tensor) -> Tensor:
    """Pressure (B, 1, n, n), at the rim and just beyond it the mean of the points in contact.

    Pressure ends within an object's edge, which lies between points: read from the points alone,
    the yield of a soft object would fall to 0 there, and its edge would stand out.
    """
    touching = F.avg_pool2d((pressure > 0).float(), 3, 1, 1)
    near = F.avg_pool2d(pressure, 3, 1, 1) / touching.clamp(min=1 / 9)
    return torch.where(touching > 0.99, pressure, near)


def _affine(contact: ContactState, frame: int) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Maps from places in the image to the object's frame, and to its overlap without its heights.

    Returns:
        Factor and shift of places as complex numbers x + i y, mm; factors (3,) of x, y and their
        squared length, and the constant, of the overlap of the object's lowest plane with the gel,
        mm.
    """
    pose = contact.pose[frame]
    cos, sin = torch.cos(pose[2]), torch.sin(pose[2])
    turn = torch.complex(cos, -sin)
    shift = -torch.complex(pose[0], pose[1]) * turn
    tilt = pose[4:]
    across, down = cos * tilt[0] - sin * tilt[1], sin * tilt[0] + cos * tilt[1]
    high = contact.depth[frame] - shift.real * tilt[0] - shift.imag * tilt[1]
    return turn, shift, torch.stack([-across, -down, -contact.bend[frame]]), high


def _sample(field: Tensor, there: Tensor, padding: str = "zeros") -> Tensor:
    """A field (B, 1, h, w) at places (B, H, W, 2) from -1 to 1: (B, H, W)."""
    return F.grid_sample(field, there, padding_mode=padding, align_corners=False)[:, 0]
