"""Convolutions of small square fields with the response of a gel, by matrices of cosines and sines.

A solver convolves fields of about 50 x 50 points thousands of times in a scene. At that size four
products with matrices take less than half the time of a padded fast Fourier transform and its
inverse, and the real parts of even and odd responses need no complex numbers.

A field's spectrum is float32 (2 m, 2 m) with m = n + 1 wave numbers a side: the upper rows belong
to cosines down the field and the lower ones to sines, the left columns to cosines across it and the
right ones to sines. An even response multiplies it; an odd one also exchanges cosine and sine.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor

#: Axes of the fields, the rows and the columns in spectra seen as (..., K, 2, m, 2, m).
FIELDS, ROWS, COLUMNS = -5, -4, -2


@dataclass(frozen=True)
class Waves:
    """Transforms of fields of n x n points with a period of twice that, and back.

    Attributes:
        there: float32 (2 m, n), field to spectrum along one axis.
        back: float32 (n, 2 m), the inverse.
    """

    there: Tensor
    back: Tensor

    @classmethod
    def of(cls, points: int, device: str) -> Waves:
        """The transforms of a grid of ``points`` a side."""
        wave = torch.arange(points + 1, dtype=torch.float64)[:, None]
        angle = math.pi / points * wave * torch.arange(points, dtype=torch.float64)
        there = torch.cat([angle.cos(), angle.sin()])
        share = torch.full((points + 1,), 1 / points, dtype=torch.float64)
        share[0] = share[-1] = 0.5 / points
        back = (there * share.repeat(2)[:, None]).T
        return cls(*(part.float().contiguous().to(device) for part in (there, back)))

    def spectrum(self, field: Tensor) -> Tensor:
        """Spectra (..., 2 m, 2 m) of fields (..., n, n)."""
        return _between(self.there, field)

    def field(self, spectrum: Tensor) -> Tensor:
        """Fields (..., n, n) of spectra (..., 2 m, 2 m)."""
        return _between(self.back, spectrum)


def _between(matrix: Tensor, fields: Tensor) -> Tensor:
    """The product of a matrix, a field and the matrix transposed, for each field.

    On a CPU they are multiplied one by one: a product of a batch may be rounded differently, and
    a touch must not depend on its batch.
    """
    across = matrix.mT
    if fields.device.type != "cpu":
        out: Tensor = matrix @ fields @ across
        return out
    if fields.ndim == 3 and fields.shape[0] == 1:  # nothing to stack: most touches are solved alone
        return torch.mm(torch.mm(matrix, fields[0]), across).unsqueeze_(0)
    side = matrix.shape[0]
    out = fields.new_empty(*fields.shape[:-2], side, side)
    flat = fields.reshape(-1, *fields.shape[-2:])
    each = zip(flat.unbind(), out.view(-1, side, side).unbind(), strict=True)
    for one, into in each:
        # Copies begin at aligned addresses, like a field of its own.
        torch.mm(torch.mm(matrix, one.clone()), across, out=into)
    return out


def table(response: Tensor, odd: tuple[int, ...] = ()) -> Tensor:
    """Factors of a spectrum for a response.

    Args:
        response: float (..., m, m), at wave numbers 0 to n down and across: the transform of a
            response that is even along both axes. Along one odd axis, the transform over i.
        odd: Axes along which the response is odd, of `ROWS` and `COLUMNS`.

    Returns:
        float32 (..., 2 m, 2 m), to be multiplied with a spectrum that `exchanged` has prepared for
        the odd axes.
    """
    m = response.shape[-1]
    out = response[..., None, :, None, :].expand(*response.shape[:-2], 2, m, 2, m).clone()
    for axis in odd:
        # i g (c - i s) = g s + i g c: the new cosine part is g s, and the sine part -g c.
        out.select(axis, 1).neg_()
    if len(odd) == 2:  # i times i
        out.neg_()
    return out.flatten(-4, -3).flatten(-2, -1).float().contiguous()


def exchanged(spectrum: Tensor, *axes: int) -> Tensor:
    """Spectra with cosines and sines, or two fields, exchanged along axes."""
    m = spectrum.shape[-1] // 2
    apart = spectrum.view(*spectrum.shape[:-2], 2, m, 2, m)
    return apart.flip(axes).view(spectrum.shape)
