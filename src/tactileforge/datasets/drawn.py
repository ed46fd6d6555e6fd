"""Touch that is drawn: the imprint of an indenter's height map, lit by three coloured lights."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

Array: TypeAlias = NDArray[Any]

_GEL_MM = 16.0


@dataclass(frozen=True)
class Shape:
    """An indenter: its height map (mm, 0 at its lowest point), how it resists, how it looks."""

    height: Callable[[Array, Array], Array]
    stiffness: float  # N at a depth of 1 mm
    exponent: float  # of the depth: 1.5 for spheres (Hertz), 1 for lines and faces
    colour: tuple[int, int, int]
    round: bool = False


def _box(x: Array, y: Array, half_x: float, half_y: float) -> Array:
    """A flat face with steep walls."""
    outside: Array = np.maximum(np.abs(x) - half_x, np.abs(y) - half_y)
    return -4 * np.maximum(outside, 0)


SHAPES = {
    "sphere": Shape(lambda x, y: -(x**2 + y**2) / 8, 5, 1.5, (205, 70, 60), round=True),
    "cylinder": Shape(lambda x, y: _box(x, 0 * y, 4.5, 1) - y**2 / 5, 6, 1, (60, 120, 200)),
    "bar": Shape(lambda x, y: _box(x, y, 4, 1.2), 7, 1, (225, 190, 60)),
    "ring": Shape(
        lambda x, y: -1.2 * (np.hypot(x, y) - 3) ** 2, 6, 1.25, (90, 180, 90), round=True
    ),
    "cross": Shape(
        lambda x, y: np.maximum(_box(x, y, 4, 0.8), _box(x, y, 0.8, 4)), 7, 1, (150, 90, 180)
    ),
    "dots": Shape(
        lambda x, y: -((np.abs(x) - 2.2) ** 2 + (np.abs(y) - 2.2) ** 2) / 1.5, 5, 1.5, (80, 85, 95)
    ),
}


@dataclass(frozen=True)
class Optics:
    """How a sensor looks: colour, how far the lights tint it, how strongly they shade slopes."""

    base: tuple[float, float, float]
    tint: float
    gain: float


SENSORS = {
    "digit": Optics((95, 85, 100), 65, 90),
    "gelsight": Optics((170, 165, 180), 20, 60),
    "gelsight_mini": Optics((90, 110, 115), 30, 70),
}


@dataclass(frozen=True)
class DrawnFrames:
    """Frames that are drawn when they are read.

    Attributes:
        count: Number of frames.
        size: Height and width.
        draw: Frame number to uint8 (size, size, 3); always the same for the same number.
    """

    count: int
    size: int
    draw: Callable[[int], NDArray[np.uint8]]

    def __len__(self) -> int:
        return self.count

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width."""
        return self.size, self.size

    def read(self, indices: Sequence[int]) -> NDArray[np.uint8]:
        """Draws; see `contracts.Frames.read`."""
        return np.stack([self.draw(int(i)) for i in indices])


def touch(
    name: str, sensor: str, path: Array, size: int, seed: tuple[int, int], i: int
) -> NDArray[np.uint8]:
    """One frame of a gel.

    Args:
        name: One of `SHAPES`.
        sensor: One of `SENSORS`.
        path: float (T, 4), position x and y (mm), angle (rad) and depth (mm) of the indenter.
        size: Height and width of the frame.
        seed: Of the unit of the sensor, and of the noise.
        i: Number of the frame.

    Returns:
        uint8 (size, size, 3), RGB.
    """
    x, y, angle, depth = path[i]
    across, down = _turned(size, x, y, angle)
    # The gel rounds edges off: a soft version of max(0, depth + height).
    sharp = 8 * (depth + SHAPES[name].height(across, down))
    pressed = np.logaddexp(0, np.clip(sharp, -30, 30)) / 8 if depth > 0 else 0 * sharp
    slope_y, slope_x = np.gradient(pressed, _GEL_MM / size)
    still, lights = _unit(sensor, size, seed)
    shade = np.clip(np.stack([slope_x, slope_y], axis=-1) @ lights, -1, 1)
    noise = np.random.default_rng([*seed, i]).standard_normal((size, size, 3), np.float32)
    frame = still * (1 - 0.06 * pressed[..., None]) + SENSORS[sensor].gain * shade + 1.5 * noise
    out: NDArray[np.uint8] = np.clip(frame, 0, 255).astype(np.uint8)
    return out


@lru_cache(maxsize=64)
def _unit(sensor: str, size: int, seed: tuple[int, int]) -> tuple[Array, Array]:
    """One unit of a sensor: its gel at rest (size, size, 3), directions of its lights (2, 3)."""
    optics, rng = SENSORS[sensor], np.random.default_rng([*seed, size])
    angles = np.deg2rad([90, 210, 330]) + rng.normal(0, 0.15, 3)
    lights = np.stack([np.cos(angles), np.sin(angles)])
    x, y = _turned(size, 0, 0, 0)
    tint = np.stack([x, y], axis=-1) @ lights / (_GEL_MM / 2) * rng.uniform(0.7, 1.3, 3)
    base = np.array(optics.base) + rng.normal(0, 6, 3)
    return (base + optics.tint * tint).astype(np.float32), lights.astype(np.float32)


def view(name: str, size: int, seed: tuple[int, int], i: int) -> NDArray[np.uint8]:
    """The object on a table, as a camera sees it: uint8 (size, size, 3), RGB."""
    rng = np.random.default_rng([*seed, 1])
    x, y, turn = rng.uniform(-1, 1, 3)
    height = SHAPES[name].height(*_turned(size, x, y, np.pi * turn))
    slope_y, slope_x = np.gradient(np.maximum(height, -3), _GEL_MM / size)
    shade = 1 + 0.35 * np.clip(slope_x + slope_y, -1, 1)[..., None]
    table = rng.uniform(120, 220, 3) + 20 * rng.standard_normal((size, 1, 1))
    seen = np.where(height[..., None] > -2.5, np.array(SHAPES[name].colour) * shade, table)
    noise = 3 * rng.standard_normal((size, size, 3))
    out: NDArray[np.uint8] = np.clip(seen + noise, 0, 255).astype(np.uint8)
    return out


def _turned(size: int, x: float, y: float, angle: float) -> tuple[Array, Array]:
    """Coordinates of the pixels in the frame of an indenter, mm."""
    line = ((np.arange(size) + 0.5) / size - 0.5) * _GEL_MM
    right, down = np.meshgrid((line - x).astype(np.float32), (line - y).astype(np.float32))
    cos, sin = np.float32(np.cos(angle)), np.float32(np.sin(angle))
    return cos * right + sin * down, cos * down - sin * right
