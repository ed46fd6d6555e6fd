"""The gel: an elastic layer bonded to a rigid back, and its surface's response to traction.

Source: K. L. Johnson, *Contact Mechanics* (1985); the half-space is the limit of a thick layer.
Letters: E and nu are the moduli, G = E / (2 (1 + nu)), h the thickness, q a wave number, k = q h.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property, lru_cache

import torch
from torch import Tensor

from tactileforge.errors import ConfigError
from tactileforge_depth.waves import COLUMNS, FIELDS, ROWS, Waves, exchanged, table

#: Beyond this product of wave number and thickness a layer is a half-space.
_THICK = 30.0
#: Points a side of the largest grid of a kernel's computation.
_LARGEST = 2048


@dataclass(frozen=True, kw_only=True)
class Gel:
    """An elastic layer bonded to a rigid back.

    The defaults are those of a GelSight Mini (FEATS: 4 mm, 3 G = 0.435 MPa; with its friction of 1,
    this Poisson's ratio meets the four forces that FEATS measured within 10 %).

    Attributes:
        thickness: Thickness of the layer, mm.
        modulus: Young's modulus, MPa.
        poisson: Poisson's ratio; gels are nearly incompressible.
        friction: Coulomb's coefficient between gel and object.
        dome: Radius of curvature of the surface at rest, mm; None for a flat gel.
        viscosity: Relaxation time of the viscous part of the pressure, s.

    Raises:
        ConfigError: A number is outside its limits; the message gives its name and the limit.
    """

    thickness: float = 4.0
    modulus: float = 0.435
    poisson: float = 0.4875
    friction: float = 1.0
    dome: float | None = None
    viscosity: float = 0.0

    def __post_init__(self) -> None:
        for name in ("thickness", "modulus", "dome"):
            value = getattr(self, name)
            if value is not None and not (value > 0 and math.isfinite(value)):
                raise ConfigError(f"gel: {name} is {value}, but must be greater than 0")
        if not 0 <= self.poisson < 0.5:
            raise ConfigError(f"gel: poisson is {self.poisson}, but must be in 0 to below 0.5")
        for name in ("friction", "viscosity"):
            if not 0 <= getattr(self, name) < math.inf:
                raise ConfigError(f"gel: {name} is {getattr(self, name)}, but must not be < 0")

    @property
    def shear_modulus(self) -> float:
        """G, MPa."""
        return self.modulus / (2 * (1 + self.poisson))

    def rest(self, x: Tensor, y: Tensor) -> Tensor:
        """Depth of the surface at rest below its apex, mm, at places in mm from the centre."""
        if self.dome is None:
            return torch.zeros_like(x)
        return (x**2 + y**2) / (2 * self.dome)


@dataclass(frozen=True)
class Compliance:
    """Displacement of the surface for unit traction, per wave number.

    Attributes:
        normal: Depth for pressure, mm/MPa.
        along: Displacement along the wave for traction along it.
        across: The same across the wave.
        coupling: Displacement along the wave (times i) for pressure; negative means outwards.
    """

    normal: Tensor
    along: Tensor
    across: Tensor
    coupling: Tensor


def compliance(gel: Gel, wave: Tensor) -> Compliance:
    """The compliance of a gel at wave numbers.

    Args:
        gel: The layer.
        wave: float64, wave numbers, rad/mm, 0 or more.

    Returns:
        Four tensors of the shape of ``wave``, mm/MPa.
    """
    nu, shear, h = gel.poisson, gel.shear_modulus, gel.thickness
    uniform = wave == 0
    q = torch.where(uniform, 1.0, wave)
    # cosh overflows for short waves; beyond this the layer is a half-space, (1 - nu) / (G q).
    k = (q * h).clamp(max=_THICK)
    kappa = 3 - 4 * nu  # Kolosov's constant in plane strain
    denominator = 2 * kappa * torch.cosh(2 * k) + 4 * k**2 + 1 + kappa**2
    sinh = 2 * kappa * torch.sinh(2 * k)
    mixed = 2 * kappa * (kappa - 1) * (torch.cosh(2 * k) - 1) - 8 * k**2
    # A uniform pressure meets the confined modulus 2 G (1 - nu) / (1 - 2 nu); a uniform shear, G.
    confined = h * (1 - 2 * nu) / (2 * shear * (1 - nu))
    half_space = (1 - nu) / (shear * q)
    return Compliance(
        normal=torch.where(uniform, confined, half_space * (sinh - 4 * k) / denominator),
        along=torch.where(uniform, h / shear, half_space * (sinh + 4 * k) / denominator),
        # Shear across the wave is antiplane, and independent of Poisson's ratio.
        across=torch.where(uniform, h / shear, torch.tanh(k) / (shear * q)),
        coupling=torch.where(uniform, 0.0, mixed / (4 * shear * q * denominator)),
    )


@dataclass(frozen=True)
class Kernel:
    """The compliance of a gel on a square grid, ready for convolution.

    A field of ``points`` x ``points`` is padded to twice that, so that nothing wraps around.

    Attributes:
        points: Points a side of the grid of traction.
        spacing: Distance between points, mm.
        normal: float32 (2 n, n + 1), for pressure to depth.
        tangent: float32 (3, 2 n, n + 1), the parts xx, xy, yy for shear to lateral displacement.
        coupling: float32 (2, 2 n, n + 1), x and y, for pressure to lateral displacement, times i.
    """

    points: int
    spacing: float
    normal: Tensor
    tangent: Tensor
    coupling: Tensor

    @cached_property
    def _solver(self) -> _Solver:
        return _Solver.of(self)

    def press(self, pressure: Tensor) -> Tensor:
        """Depth (mm) of the surface under a pressure (MPa), both (..., n, n)."""
        by = self._solver
        return by.waves.field(by.waves.spectrum(pressure).mul_(by.normal))

    def drag(self, shear: Tensor) -> Tensor:
        """Lateral displacement (mm) of the surface under shear traction (MPa): (..., 2, n, n)."""
        by = self._solver
        spectrum = by.waves.spectrum(shear)
        turned = exchanged(spectrum, FIELDS, ROWS, COLUMNS)
        return by.waves.field(spectrum.mul_(by.straight).addcmul_(turned, by.mixed))

    def spread(self, pressure: Tensor) -> Tensor:
        """Lateral displacement (mm) of the surface under pressure (MPa): (..., 2, n, n)."""
        by = self._solver
        spectrum = by.waves.spectrum(pressure)
        x, y = exchanged(spectrum, COLUMNS), exchanged(spectrum, ROWS)
        return by.waves.field(torch.stack([x, y], -3).mul_(by.coupling))

    def lift(self, shear: Tensor) -> Tensor:
        """Depth (mm) of the surface under shear traction (MPa), from (..., 2, n, n).

        By reciprocity it is the transpose of `spread`: the gel bulges ahead of a dragging object,
        and sinks behind it.
        """
        by = self._solver
        x, y = by.waves.spectrum(shear).unbind(-3)
        lifted = exchanged(x, COLUMNS).mul_(by.coupling[0])
        lifted.addcmul_(exchanged(y, ROWS), by.coupling[1])
        return by.waves.field(lifted.neg_())

    def lifted(self, shear: Tensor) -> Tensor:
        """The spectrum of the depth, for one of the shear traction: (..., 2n, n+1)."""
        out: Tensor = (-1j * self.coupling * shear).sum(-3)
        return out

    def dragged(self, shear: Tensor) -> Tensor:
        """The spectrum of the lateral displacement, for one of the traction: (..., 2, 2n, n+1)."""
        xx, xy, yy = self.tangent
        x, y = shear.unbind(-3)
        return torch.stack([xx * x + xy * y, xy * x + yy * y], -3)


@dataclass(frozen=True)
class _Solver:
    """A kernel as factors of the spectra of `waves`.

    Attributes:
        waves: Transforms of fields.
        normal: (2 m, 2 m), for pressure to depth.
        straight: (2, 2 m, 2 m), the parts xx and yy for shear to lateral displacement.
        mixed: (2 m, 2 m), the part xy.
        coupling: (2, 2 m, 2 m), x and y, for pressure to lateral displacement.
    """

    waves: Waves
    normal: Tensor
    straight: Tensor
    mixed: Tensor
    coupling: Tensor

    @classmethod
    def of(cls, kernel: Kernel) -> _Solver:
        m = kernel.points + 1
        xx, xy, yy = kernel.tangent[:, :m]
        right, down = kernel.coupling[:, :m]
        return cls(
            Waves.of(kernel.points, str(kernel.normal.device)),
            table(kernel.normal[:m]),
            table(torch.stack([xx, yy])),
            table(xy, (ROWS, COLUMNS)),
            torch.stack([table(right, (COLUMNS,)), table(down, (ROWS,))]),
        )


def kernel(gel: Gel, points: int, spacing: float, device: str = "cpu") -> Kernel:
    """The kernel of a gel on a grid; the last 16 are cached.

    Args:
        gel: The layer.
        points: Points a side.
        spacing: Distance between points, mm.
        device: Device of the tensors.

    Raises:
        ConfigError: The grid has no points or no spacing.
    """
    if points < 2 or not spacing > 0:
        raise ConfigError(f"a grid of {points} points, {spacing} mm apart; give 2 or more, and > 0")
    return _kernel(gel.thickness, gel.modulus, gel.poisson, points, spacing, device)


def inverse_transform(spectrum: Tensor) -> Tensor:
    """Fields (..., m, m) of spectra (..., m, m / 2 + 1), as by ``torch.fft.irfft2``.

    On a CPU they are transformed one by one: with AVX-512, MKL rounds a batch differently from a
    single field, and a touch must not depend on its batch.
    """
    size = (spectrum.shape[-2],) * 2
    if spectrum.device.type != "cpu" or spectrum.ndim == 2:
        out: Tensor = torch.fft.irfft2(spectrum, s=size)
        return out
    if spectrum.shape[:-2].numel() == 1:  # nothing to stack, and most touches are solved alone
        alone: Tensor = torch.fft.irfft2(spectrum[(0,) * (spectrum.ndim - 2)], s=size)
        return alone.view(*spectrum.shape[:-2], *size)
    each = [torch.fft.irfft2(one, s=size) for one in spectrum.flatten(0, -3)]
    return torch.stack(each).view(*spectrum.shape[:-2], *size)


@lru_cache(maxsize=16)
def _kernel(
    thickness: float, modulus: float, poisson: float, points: int, spacing: float, device: str
) -> Kernel:
    gel = Gel(thickness=thickness, modulus=modulus, poisson=poisson)
    # The response to a point load on a plate so large that its periodic images do not matter, cut
    # to size: sampled on the small grid itself, the spectrum would let the images overlap.
    large = 2 * points
    while large * spacing < 16 * thickness and large < _LARGEST:
        large *= 2
    qx = 2 * math.pi * torch.fft.rfftfreq(large, spacing, dtype=torch.float64)
    qy = 2 * math.pi * torch.fft.fftfreq(large, spacing, dtype=torch.float64)[:, None]
    wave = torch.hypot(qx, qy)
    x, y = (q / wave.clamp(min=1e-12) for q in (qx, qy))
    # The shortest wave of a grid has no sine: a response that is odd in it is 0.
    odd_x, odd_y = torch.where(qx < qx.max(), x, 0.0), torch.where(qy > qy.min(), y, 0.0)
    of = compliance(gel, wave)
    more = of.along - of.across
    # In axes of the wave compliance is diagonal (along, across); n n^T turns it into x and y.
    even = torch.stack(
        [of.normal, of.across + more * x**2, more * odd_x * odd_y, of.across + more * y**2]
    )
    even = _cut(even.to(torch.complex128), points).real
    # Coupling is odd in the wave vector: times i, its response in space is real.
    odd = _cut(1j * torch.stack([of.coupling * odd_x, of.coupling * odd_y]), points).imag
    normal, tangent = even[0], even[1:]
    return Kernel(
        points,
        spacing,
        *(part.to(torch.float32).contiguous().to(device) for part in (normal, tangent, odd)),
    )


def _cut(spectrum: Tensor, points: int) -> Tensor:
    """The spectrum of a kernel cut down to a grid of 2 ``points`` a side."""
    large = spectrum.shape[-2]
    if large == 2 * points:
        return spectrum
    field = torch.fft.irfft2(spectrum, s=(large, large))
    rows = torch.arange(-points, points) % large
    part = field[..., rows, :][..., rows]
    part[..., 0, 0] = 0  # the corner, too far to act on any point, has no opposite to be odd with
    out: Tensor = torch.fft.rfft2(torch.fft.ifftshift(part, dim=(-2, -1)))
    return out
