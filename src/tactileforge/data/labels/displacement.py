"""Displacement field (3-D optical flow) of a gel's surface as a small image: RGB is x, y, z.

As in drawn taxels, 128 stands for none. The other values follow the square root: the weak slope
around a contact keeps several levels, and the deepest dent still fits.
"""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

#: Displacement coded as 255 (as is more), along x, y and z, mm.
RANGE_MM = (0.6, 0.6, 2.0)
#: Value of no displacement.
NONE = 128
#: Rows or columns of the image, whichever are fewer.
SIZE = 32
#: Height and width in a batch, pixels.
SHAPE = (SIZE, SIZE)


def grid_shape(height: int, width: int) -> tuple[int, int]:
    """Rows and columns of the displacement image of a frame, given its height and width."""
    short = min(height, width)
    return round(height * SIZE / short), round(width * SIZE / short)


def encode_displacement(displacement: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Encode displacements as an image.

    Args:
        displacement: float32 (..., 3), mm along x and y of the image, and z into the gel.

    Returns:
        uint8 (..., 3).
    """
    share = displacement / np.asarray(RANGE_MM, np.float32)
    # 127 levels on each side of 128: the sign of a level is that of the displacement
    root = np.sign(share) * np.sqrt(np.abs(share))
    image: NDArray[np.uint8] = np.rint(NONE + 127 * root.clip(-1, 1)).astype(np.uint8)
    return image


def decode_displacement(image: NDArray[np.uint8]) -> NDArray[np.float32]:
    """Decode an image of `encode_displacement` to displacements, mm, float32 (..., 3)."""
    root = (image.astype(np.float32) - NONE) / 127
    out: NDArray[np.float32] = (np.sign(root) * root**2 * np.asarray(RANGE_MM)).astype(np.float32)
    return out


def coded_displacement(images: Tensor) -> Tensor:
    """Convert images of `encode_displacement` to coded displacements, float, -1 to 1."""
    return (images.float() - NONE) / 127


def displacement_mm(coded: Tensor) -> Tensor:
    """Convert coded displacements, float (..., 3, H, W), -1 to 1, to mm."""
    return coded * coded.abs() * _range_of(coded)


def displacement_images(mm: Tensor) -> Tensor:
    """Encodes displacements as `encode_displacement` does: uint8 (..., 3, H, W) of mm, float."""
    share = mm / _range_of(mm)
    root = share.sign() * share.abs().sqrt()
    return (NONE + 127 * root.clamp(-1, 1)).round().to(torch.uint8)


def _range_of(images: Tensor) -> Tensor:
    """Range (3, 1, 1), filled in on the device: a copy from the host would be waited for."""
    whole = images.new_empty(3)
    for axis, most in enumerate(RANGE_MM):
        whole[axis].fill_(most)
    return whole.view(3, 1, 1)


def mirror_displacement(images: Tensor, axis: int) -> Tensor:
    """Mirror displacement images: displacement along the axis changes its sign.

    Args:
        images: uint8 (..., 3, H, W).
        axis: 0 mirrors left to right, 1 top to bottom.
    """
    out = images.flip(-1 - axis)
    along = out[..., axis, :, :]
    # 1 to 255 are symmetric about 128; nothing is coded as 0
    out[..., axis, :, :] = (2 * NONE - along.short()).clamp(max=255).to(torch.uint8)
    return out
