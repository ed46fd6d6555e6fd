"""Pixels of turned, moved and relit clips, on the device, for a whole batch at once."""

from __future__ import annotations

import math

import torch
from torch import Tensor

from tactileforge.data.labels import displacement


def sample(images: Tensor, warp: Tensor, padding: str) -> Tensor:
    """Move images, with linear interpolation.

    Args:
        images: float (B, C, H, W).
        warp: float (B, 2, 3), see `move_clip`.
        padding: Pixels from beyond the border: ``zeros`` or ``reflection``.
    """
    from kornia.geometry.transform import warp_affine

    height, width = images.shape[-2:]
    # filled in on the device: a tensor of the host would be waited for
    sides = warp.new_ones(2)
    sides[0], sides[1] = width, height
    linear = warp[:, :, :2] * sides[:, None] / sides
    centre = (sides - 1) / 2
    shift = warp[:, :, 2] * sides + centre - (linear @ centre[:, None])[..., 0]
    matrix = torch.cat([linear, shift[..., None]], dim=2)
    size = (height, width)
    out: Tensor = warp_affine(images, matrix, size, padding_mode=padding, align_corners=False)
    return out


def move_clip(clip: Tensor, warp: Tensor) -> Tensor:
    """Moves backgrounds and frames alike; what comes in from outside is the gel at rest.

    Beyond its border a background is reflected, for a gel at rest goes on as it is. Frames show
    this background there: a reflected contact would be a second one, which no force label has.

    Args:
        clip: float (B, 1 + T, 3, H, W), levels; the background first.
        warp: float (B, 2, 3), place after the change of a place before it; both in shares of width
            and height from the centre of the picture.

    Returns:
        The clip, of the same shape.
    """
    rest = sample(clip[:, 0], warp, "reflection")
    # moved along with the frames: where it is below 1, a pixel comes from beyond the border
    inside = torch.ones_like(clip[:, 0, :1])
    moved = sample(torch.cat([clip[:, 1:].flatten(1, 2), inside], dim=1), warp, "zeros")
    frames = moved[:, :-1].reshape(clip[:, 1:].shape)
    return torch.cat([rest[:, None], frames + (1 - moved[:, None, -1:]) * rest[:, None]], dim=1)


def move_surface(surface: Tensor, warp: Tensor, turn: Tensor) -> Tensor:
    """Moves displacement images, and turns the displacements; at rest outside of the picture.

    Args:
        surface: uint8 (B, T, 3, H, W), see `displacement`.
        warp: float (B, 2, 3), as in `move_clip`.
        turn: float (B, 3, 3), turns of vectors.
    """
    mm = displacement.displacement_mm(displacement.coded_displacement(surface))
    moved = sample(mm.flatten(1, 2), warp, "zeros").view_as(mm)
    turned = torch.einsum("bij,btjhw->btihw", turn, moved)
    return displacement.displacement_images(turned)


def light_clip(clip: Tensor, light: Tensor, blur: float, noise: bool) -> Tensor:
    """Blurs and lights backgrounds and frames alike, and adds noise to frames.

    A background is the median of several frames, in which the noise is lost.

    Args:
        clip: float (B, 1 + T, 3, H, W), levels; the background first. It is used up.
        light: float (B, 5): factors of red, green and blue; deviations of blur, pixels, and of
            noise, levels.
        blur: Largest deviation of the blur, pixels; 0 for none.
        noise: Whether any frames get noise.

    Returns:
        The clip, of the same shape.
    """
    if blur:
        from kornia.filters import filter2d_separable, get_gaussian_kernel1d

        # each clip by its own Gauss: kornia's gaussian_blur2d reads the deviations back, for which
        # the host would wait. Three deviations to each side hold all of it but .3 %
        kernel = get_gaussian_kernel1d(2 * math.ceil(3 * blur) + 1, light[:, 3:4].clamp(min=1e-3))
        flat: Tensor = filter2d_separable(clip.flatten(1, 2), kernel, kernel, "replicate")
        clip = flat.view_as(clip)
    clip *= light[:, None, :3, None, None]
    if noise:
        frames = clip[:, 1:]
        frames += light[:, 4, None, None, None, None] * torch.randn_like(frames)
    return clip


def as_levels(clip: Tensor) -> Tensor:
    """Levels of pixels, uint8, of floats; overwrites the floats."""
    return clip.round_().clamp_(0, 255).to(torch.uint8)
