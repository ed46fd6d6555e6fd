"""Drawings of a ball in a gel: simple enough to read, and enough like touch to learn from."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

#: Colour of the gel without contact, RGB.
GEL = (120.0, 130.0, 140.0)
#: Radius of the ball, in halves of the image.
RADIUS = 0.8


def press(
    depth: float, height: int, width: int, centre: tuple[float, float] = (0.0, 0.0)
) -> NDArray[np.uint8]:
    """Draws a ball in the gel: slopes to the right, down and left shine in R, G and B.

    Args:
        depth: Depth of the ball, in its radii: 0 (no contact) to 1.
        height: Rows of the image.
        width: Columns of the image.
        centre: Position of the ball, y and x in -1..1.

    Returns:
        uint8 (height, width, 3), RGB.
    """
    y, x = np.mgrid[-1 : 1 : height * 1j, -1 : 1 : width * 1j]
    y, x = (y - centre[0]) / RADIUS, (x - centre[1]) / RADIUS
    touched = np.hypot(y, x) < np.sqrt(depth * (2 - depth))
    shade = touched[..., None] * np.stack([x, y, -x], axis=-1)
    return np.asarray(GEL + 100 * shade).clip(0, 255).astype(np.uint8)
