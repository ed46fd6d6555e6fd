"""The gel's surface under a contact: where it lies, and where its markers go."""

from __future__ import annotations

import torch
from torch import Tensor
from torch.nn import functional as F

from tactileforge.sim.gel import Gel, kernel
from tactileforge.sim.touch import Contact

#: Points of a fine height map for each point of the solver's.
DETAIL = 4
#: mm by which an object's detail may differ from what the solver saw of it.
_RELIEF = 0.15


class Surface:
    """Surfaces of a batch of touches, from what `touch.contacts` yields.

    The solver's displacement is continued to twice the width of its grid. In the contact the gel
    takes the object's own shape, so its fine detail is added there.

    Args:
        heights: float32 (B, n, n), the maps that the solver was given.
        fine: float32 (B, 4 n, 4 n), the same objects at a quarter of the spacing.
        spacing: mm between the points of ``heights``.
        gel: Any of the gels; only thickness and Poisson's ratio count.
    """

    def __init__(self, heights: Tensor, fine: Tensor, spacing: float, gel: Gel) -> None:
        self.n, self.spacing = heights.shape[-1], spacing
        unit = Gel(thickness=gel.thickness, poisson=gel.poisson, modulus=1.0)
        self.kernel = kernel(unit, self.n, spacing, str(heights.device))
        smooth = F.interpolate(heights[:, None], scale_factor=DETAIL, mode="bicubic")
        self.relief = (smooth - fine[:, None]).clamp(-_RELIEF, _RELIEF)

    def fields(self, contact: Contact) -> tuple[Tensor, Tensor]:
        """Displacement into the gel (B, 1, 4 n, 4 n), mm, and detail in the contact (the same).

        The first spans twice the width of the second, both around the object.
        """
        pressure = contact.strain[:, :1]
        spectrum = self.kernel.normal * self._spectrum(pressure)
        n = self.n
        wide = torch.zeros(
            (*spectrum.shape[:2], 4 * n, 2 * n + 1), dtype=spectrum.dtype, device=spectrum.device
        )
        wide[..., :n, :n], wide[..., -n:, :n] = spectrum[..., :n, :n], spectrum[..., -n:, :n]
        depth = 4 * torch.fft.irfft2(wide, s=(4 * n, 4 * n))
        touched = F.interpolate((pressure > 0).float(), scale_factor=DETAIL, mode="bilinear")
        return depth, touched * self.relief

    def picture(self, fields: tuple[Tensor, Tensor], pose: Tensor, places: Tensor) -> Tensor:
        """The depth of the surface at places of pictures.

        Args:
            fields: Of `fields`, or rows of it.
            pose: float32 (B, 6), those of the contact.
            places: float32 (H, W, 2), x and y of the pixels, mm from the centre.

        Returns:
            float32 (B, H, W), mm into the gel, from its surface at rest.
        """
        depth, detail = fields
        n = self.n
        there = _unplaced(places, pose) / self.spacing
        # Points lie at the centres of cells; the solver's grid sits in the middle of the wide one,
        # whose points are those of the grid and one between each two of them.
        out = F.grid_sample(depth, (there - 0.25) / n, align_corners=False)
        out = out + F.grid_sample(detail, 2 * there / n, align_corners=False)
        return out[:, 0]

    def lateral(self, contact: Contact, places: Tensor) -> Tensor:
        """How far points of the surface move sideways.

        Args:
            contact: The moment.
            places: float32 (B, M, 2), x and y at rest, mm from the centre of the picture.

        Returns:
            float32 (B, M, 2), mm along x and y of the picture.
        """
        pressure, shear = contact.strain[:, :1], contact.strain[:, 1:]
        moved = self.kernel.dragged(self._spectrum(shear))
        moved = moved + 1j * self.kernel.coupling * self._spectrum(pressure)
        n = self.n
        field = torch.fft.irfft2(moved, s=(2 * n, 2 * n))
        there = _unplaced(places[:, None], contact.pose) / self.spacing
        out = F.grid_sample(field, there / n, align_corners=False)[:, :, 0]
        angle = contact.pose[:, 2, None]
        cos, sin = torch.cos(angle), torch.sin(angle)
        x, y = out.unbind(1)
        return torch.stack([cos * x - sin * y, sin * x + cos * y], -1)

    def _spectrum(self, field: Tensor) -> Tensor:
        """Of a field in the middle of a grid of twice its width."""
        edge = self.n // 2
        out: Tensor = torch.fft.rfft2(F.pad(field, (edge,) * 4))
        return out


def _unplaced(places: Tensor, pose: Tensor) -> Tensor:
    """Places (..., H, W, 2) in the picture, as (B, H, W, 2) in the frames of the objects."""
    moved = places - pose[:, None, None, :2]
    angle = pose[:, 2, None, None]
    cos, sin = torch.cos(angle), torch.sin(angle)
    x, y = moved.unbind(-1)
    return torch.stack([cos * x + sin * y, cos * y - sin * x], -1)
