"""Drawn touches for examples of checks: a DIGIT's colours, an imprint, and the force of it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from tactileforge.contracts import Recording
from tactileforge.data.frames.lazy import ArrayFrames
from tactileforge.sensors.resting_colours import known_colours

#: Frames, frames a second, height and width, and largest force of a drawn touch, N.
COUNT, FPS, HEIGHT, WIDTH, NEWTON = 90, 30.0, 80, 60, 6.0


def resting(seed: int = 0, height: int = HEIGHT, width: int = WIDTH) -> NDArray[np.float64]:
    """Draw the gel of a DIGIT at rest, float64 (height, width, 3), grey levels.

    Args:
        seed: Number of the unit: each has lights of its own strength.
        height: Rows of the picture.
        width: Columns of the picture.
    """
    grid = known_colours("digit")
    assert grid is not None
    lights = 1 + 0.1 * np.random.default_rng(seed).normal(size=3)
    drawn = cv2.resize(0.25 * lights * grid, (width, height), interpolation=cv2.INTER_CUBIC)
    return np.asarray(110 + drawn, np.float64)


def press(count: int = COUNT) -> NDArray[np.float64]:
    """Depth of one press over time, 0 to 1, float64 (count,); at rest at both ends."""
    at = np.linspace(-0.125, 1.125, count)
    return np.where((at > 0) & (at < 1), np.sin(np.pi * np.clip(at, 0, 1)) ** 2, 0.0)


def pictures(
    depth: NDArray[np.float64], seed: int = 0, still: NDArray[np.float64] | None = None
) -> NDArray[np.uint8]:
    """Draw noisy pictures of a gel with a round imprint that also slides a little.

    Args:
        depth: Depth of the imprint in each frame, 0 to 1, (count,).
        seed: Seed of the noise and of the place.
        still: Gel at rest; None draws one.
    """
    still = resting(seed) if still is None else still
    rng = np.random.default_rng(seed)
    height, width = still.shape[:2]
    y, x = np.mgrid[:height, :width]
    row, column = rng.uniform(0.35, 0.65, 2) * (height, width)
    out = np.empty((len(depth), height, width, 3), np.uint8)
    for i, deep in enumerate(depth):
        away = (y - row) ** 2 + (x - column - 4 * np.sin(i / 15)) ** 2
        bump = 7 * np.exp(-away / (0.02 * height * width))
        down, right = np.gradient(bump)
        slope = np.stack([right, down, -right], -1)
        noise = rng.normal(0, 1, still.shape)
        out[i] = np.clip(still + 70 * deep * slope + noise, 1, 254)
    return out


def made_touch(
    seed: int = 0,
    edit: Callable[[NDArray[np.uint8]], Any] | None = None,
    still: NDArray[np.float64] | None = None,
    depth: NDArray[np.float64] | None = None,
    **fields: Any,
) -> Recording:
    """Draw one press of a DIGIT, three seconds long, with its force; nothing is wrong with it.

    Args:
        seed: Number of the unit and of the touch.
        edit: Changes the pictures, uint8 (T, H, W, 3), in place.
        still: Gel at rest; None draws one.
        depth: Depth of the imprint in each frame, 0 to 1; None presses once.
        fields: Fields of the recording in place of its own.
    """
    depth = press() if depth is None else depth
    still = resting(seed) if still is None else still
    array = pictures(depth, seed, still)
    if edit is not None:
        edit(array)
    count = len(array)
    noise = np.random.default_rng(seed + 500).normal(0, 0.01, (count, 3))
    force = noise + np.outer(depth, (0.1, 0.05, 1)) * NEWTON
    given: dict[str, Any] = {
        "key": f"made/{seed}",
        "sensor": "digit",
        "frames": ArrayFrames(array),
        "times": np.arange(count) / FPS,
        "no_contact": ArrayFrames(pictures(np.zeros(3), seed + 1000, still)),
        "force": force.astype(np.float32),
        "object": ("cup", "ball")[seed % 2],
        "text": "a finger presses it",
    }
    return Recording(**(given | fields))
