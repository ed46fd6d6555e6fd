"""The third-person camera: a plain drawing of the workspace, seen along the closing axis."""

from __future__ import annotations

from typing import TypeAlias

import cv2
import numpy as np
from numpy.typing import NDArray

#: Height and width of a picture, pixels; it is drawn `_FINE` times as large, against jagged edges.
SIZE = 96
_FINE = 4
_WALL, _FINGER, _ARM = (226, 224, 218), (92, 98, 108), (60, 64, 72)

Colour: TypeAlias = tuple[int, int, int]


class Picture:
    """A drawing in mm: x to the right, z up.

    Args:
        left: x of the left edge, mm.
        bottom: z of the lower edge, mm.
        width: Width and height of the drawn region, mm.
    """

    def __init__(self, left: float, bottom: float, width: float) -> None:
        self.left, self.bottom, self.scale = left, bottom, SIZE * _FINE / width
        self.canvas = np.full((SIZE * _FINE, SIZE * _FINE, 3), _WALL, np.uint8)

    def box(self, x: float, z: float, width: float, height: float, colour: Colour) -> None:
        """Fills a rectangle centred on x, from z up, mm."""
        half = width / 2
        corners = ((x - half, z), (x + half, z), (x + half, z + height), (x - half, z + height))
        self.polygon(corners, colour)

    def polygon(self, corners: tuple[tuple[float, float], ...], colour: Colour) -> None:
        """Fills a polygon with corners (x, z), mm."""
        cv2.fillPoly(self.canvas, [self._pixels(np.array(corners))], colour, cv2.LINE_AA)

    def disc(self, x: float, z: float, radius: float, colour: Colour) -> None:
        """Fills a disc around (x, z), mm."""
        centre = tuple(int(v) for v in self._pixels(np.array([[x, z]]))[0])
        cv2.circle(self.canvas, centre, round(radius * self.scale), colour, -1, cv2.LINE_AA)

    def gripper(self, x: float, z: float) -> None:
        """Draws the finger nearer to the camera, and the arm above it."""
        self.box(x, z - 4.0, 8.0, 16.0, _FINGER)
        self.box(x, z + 11.0, 16.0, 60.0, _ARM)

    def taken(self) -> NDArray[np.uint8]:
        """Shrinks the drawing to the picture, uint8 (96, 96, 3), RGB."""
        small = cv2.resize(self.canvas, (SIZE, SIZE), interpolation=cv2.INTER_AREA)
        return np.asarray(small, np.uint8)

    def _pixels(self, places: NDArray[np.float64]) -> NDArray[np.int32]:
        x = (places[:, 0] - self.left) * self.scale
        y = len(self.canvas) - (places[:, 1] - self.bottom) * self.scale
        return np.stack([x, y], 1).round().astype(np.int32)
