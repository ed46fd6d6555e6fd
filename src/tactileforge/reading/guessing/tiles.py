"""Composite pictures of several sensors."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

#: Of pictures that are put together: grey levels across an edge, shares of pixels along an edge
#: between parts and along usual ones, and the most parts in a row or column.
_EDGE, _MOST_OF, _FEW, _MOST_TILES = 12, 0.7, 0.3, 4
#: Of two gels of one kind beside each other: width over height, the step at their seam over those
#: elsewhere, and the correlation of their halves.
_WIDE, _SEAM, _ALIKE = 2.4, 1.5, 0.8
#: Left, top, width and height, pixels.
Box: TypeAlias = tuple[int, int, int, int]


def tiles(pictures: NDArray[np.uint8]) -> list[Box]:
    """Tiles of composite pictures, of one size; [] for others.

    Parts meet in an edge across the whole picture. Dark bars with captions are no part of them.

    Returns:
        Left, top, width and height of each, pixels, row by row.
    """
    height, width = pictures.shape[1:3]
    # an axis at a time: the share of pixels along an edge that change across it
    down, across = (
        (np.abs(np.diff(pictures.astype(np.int16), axis=axis)).max(-1) > _EDGE).mean((0, 3 - axis))
        for axis in (1, 2)
    )
    rows, columns = _parts_of(down, height), _parts_of(across, width)
    if rows * columns == 1 and width >= _WIDE * height and _are_alike(pictures):
        columns = 2
    if rows * columns == 1:
        return []
    # rows that are dark but for letters
    dark = np.median(pictures.max(-1), axis=2).max(0) < _EDGE
    out = []
    for row in range(rows):
        lit = np.flatnonzero(~dark[row * height // rows : (row + 1) * height // rows])
        if len(lit) < 8:
            return []
        top = row * height // rows
        box = (top + int(lit[0]), int(lit[-1] - lit[0]) + 1)
        out += [
            (column * width // columns, box[0], width // columns, box[1])
            for column in range(columns)
        ]
    return out


def _are_alike(pictures: NDArray[np.uint8]) -> bool:
    """Whether the halves of wide pictures are two gels of one kind with a seam between them."""
    # over all lines, where marks and noise are gone
    lines = pictures[:, :, : pictures.shape[2] // 2 * 2].mean((0, 1), dtype=np.float64)
    steps = np.abs(np.diff(lines, axis=0)).max(-1)
    seam = len(steps) // 2
    left, right = (half - half.mean(0) for half in np.split(lines, 2))
    alike = float((left * right).sum() / max(np.sqrt((left**2).sum() * (right**2).sum()), 1e-9))
    return bool(steps[seam] > _SEAM * np.quantile(steps, 0.95) and alike > _ALIKE)


def _parts_of(edges: NDArray[np.float64], size: int) -> int:
    """Number of equal parts by the edges between neighbouring rows; 1 without edges."""
    if float(np.quantile(edges, 0.9)) > _FEW:
        return 1  # edges everywhere: a pattern, or noise
    for count in range(_MOST_TILES, 1, -1):
        places = [round(size * part / count) for part in range(1, count)]
        if size // count >= 16 and all(edges[at - 2 : at + 2].max() > _MOST_OF for at in places):
            return count
    return 1
