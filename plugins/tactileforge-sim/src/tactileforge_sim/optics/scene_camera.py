"""A small image of a shape on a table, as from a camera beside the sensor."""

from __future__ import annotations

import colorsys
from functools import lru_cache
from typing import TypeAlias
from zlib import crc32

import cv2
import numpy as np
from numpy.typing import NDArray

from tactileforge.errors import ConfigError
from tactileforge_sim.geometry.indenter_geometry import DEEP, Shape

#: Side of the visible part of the table, mm; larger shapes are seen from farther away.
TABLE = 20.0
#: Number of horizontal slices of a drawn shape, and least side of an image, pixels.
_LAYERS = 12
_SMALLEST = 16

_Image: TypeAlias = NDArray[np.float32]


def render_scene_image(shape: Shape, size: int, seed: int) -> NDArray[np.uint8]:
    """Draws a shape on a random table, touching side up, tilted, lit and in its own colour.

    The same shape, size and seed give the same image.

    Args:
        shape: The object.
        size: Rows and columns of the image, at least 16.
        seed: Seed of pose, light and table.

    Returns:
        uint8 (size, size, 3), RGB.

    Raises:
        ConfigError: The image is too small.
    """
    if size < _SMALLEST:
        raise ConfigError(f"a view of {size} x {size} pixels; the limit is {_SMALLEST}")
    draw = np.random.default_rng(seed)
    turned, sunward = draw.uniform(0, 2 * np.pi, 2)
    tilt = draw.uniform(0.15, 0.4) * _direction(draw.uniform(0, 2 * np.pi))
    middle = size / 2 + draw.uniform(-0.08, 0.08, 2) * size - tilt * DEEP / 2
    zoom = draw.uniform(0.85, 1.1)
    # The affine matrix (2, 3) for a turn, a zoom about the middle, and a shift of an image.
    cosine, sine = zoom * np.cos(turned), zoom * np.sin(turned)
    turn = np.asarray([[cosine, -sine], [sine, cosine]])
    moved = middle - turn @ np.full(2, size / 2)
    pose: _Image = np.asarray(np.column_stack([turn, moved]), dtype=np.float32)
    table = _table(draw, size)

    side = max(TABLE, 2.4 * shape.radius)
    high, slope = _relief(shape, size, side)
    # Brightness under a sun at 45 degrees of elevation.
    facing = (1 - slope @ _direction(sunward - turned)) / np.sqrt(1 + (slope**2).sum(-1))
    lit = np.asarray(0.25 + 0.75 * np.clip(facing / np.sqrt(2), 0, 1), dtype=np.float32)
    # A colour of the shape's name, the same on every machine.
    code = crc32(shape.name.encode())
    hue, full, bright = code % 1009 / 1009, code // 1009 % 97 / 97, code // 97873 % 89 / 89
    rgb = colorsys.hsv_to_rgb(hue, 0.4 + 0.55 * full, 0.65 + 0.35 * bright)
    colour: _Image = np.asarray(rgb, dtype=np.float32)
    shadow = _warped(high > 0, pose, -1.5 * _direction(sunward) * size / side)
    blurred = cv2.GaussianBlur(shadow, (0, 0), size / 50)
    # Colour by colour: planes are three times as fast to blend as pixels of three numbers.
    planes = np.ascontiguousarray(table.transpose(2, 0, 1)) * (1 - 0.6 * blurred)
    step = DEEP / _LAYERS
    for level in np.arange(1, _LAYERS + 1) * step - step / 2:
        shift = tilt * level * size / side
        cover = _warped(np.clip(0.5 + (high - level) / step, 0, 1), pose, shift)
        # Layers are drawn from the bottom up: later ones cover the top, so only walls stay dark.
        shade = _warped(np.where(high < level + 2 * step, lit, 0.3), pose, shift)
        for plane, light in zip(planes, colour, strict=True):
            plane += cover * (shade * light - plane)
    picture = planes.transpose(1, 2, 0)
    picture = picture + draw.normal(0, 0.01, picture.shape)
    return np.asarray(np.clip(picture * 255, 0, 255), dtype=np.uint8)


@lru_cache(maxsize=256)
def _relief(shape: Shape, size: int, side: float) -> tuple[_Image, _Image]:
    """Height above the table, mm (n, n), and its slopes along x and y (n, n, 2)."""
    fine = 2 * size
    spacing = side / fine
    axis = (np.arange(fine) - (fine - 1) / 2) * spacing
    high = DEEP - shape.heights(axis)
    down, right = np.gradient(high, spacing)
    slope = np.stack([right, down], axis=-1)
    small = (size, size)
    return (
        cv2.resize(high.astype(np.float32), small, interpolation=cv2.INTER_AREA),
        cv2.resize(slope.astype(np.float32), small, interpolation=cv2.INTER_AREA),
    )


def _direction(angle: float) -> _Image:
    return np.asarray([np.cos(angle), np.sin(angle)], dtype=np.float32)


def _warped(image: NDArray[np.generic], pose: _Image, shift: _Image) -> _Image:
    matrix = pose.copy()
    matrix[:, 2] += shift
    size = image.shape[1], image.shape[0]
    return np.asarray(cv2.warpAffine(image.astype(np.float32), matrix, size))


def _table(draw: np.random.Generator, size: int) -> _Image:
    """A plain or grained table under uneven light, float (size, size, 3)."""
    tone = np.asarray(colorsys.hsv_to_rgb(draw.random(), draw.uniform(0, 0.35), 1.0))
    ramp = np.linspace(-1, 1, size)
    across, along = np.meshgrid(ramp, ramp)
    u, v = (across, along) if draw.random() < 0.5 else (along, across)
    waves = np.sin(draw.uniform(8, 40) * (u + 0.1 * np.sin(draw.uniform(1, 4) * v)))
    light = draw.uniform(-0.12, 0.12, 2)
    grey = draw.uniform(0.25, 0.85) + light[0] * across + light[1] * along
    grey = grey + draw.uniform(0, 0.06) * waves
    return np.asarray(grey[..., None] * tone, dtype=np.float32)
