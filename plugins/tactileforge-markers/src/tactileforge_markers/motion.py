"""Motion of a touch by the displacement of markers: shear, torsion, pressing."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

#: Fewest markers of which motion is computed, and least share of all that has to be seen.
_FEWEST, _LEAST = 4, 0.25
#: Rows and columns of the field of displacements.
FIELD = (12, 12)


@dataclass(frozen=True, kw_only=True)
class Motion:
    """Motion of all markers together; NaN where too few are seen.

    Attributes:
        shear: Mean displacement to the right and down, pixels.
        torsion: Rotation that fits best, degrees, clockwise as the picture shows it.
        divergence: Divergence of the linear field that fits best, percent; positive where markers
            move apart, as under a press.
        seen: Share of the markers that are seen.
    """

    shear: tuple[float, float]
    torsion: float
    divergence: float
    seen: float

    def message(self) -> dict[str, Any]:
        """The motion as plain data, for publishers."""
        return {
            "shear_px": [round(axis, 3) for axis in self.shear],
            "torsion_deg": round(self.torsion, 3),
            "divergence_percent": round(self.divergence, 3),
            "markers_seen": round(self.seen, 3),
        }


def marker_motion(places: NDArray[np.floating], moved: NDArray[np.floating]) -> Motion:
    """Sums up the displacement of markers.

    With p the places at rest and q those moved, each less its mean: shear is the mean of q - p
    before that, torsion is atan2(sum p x q, sum p . q), which is the rotation of least squares
    (Kabsch 1976), and divergence is the trace of G, where G p fits q - p by least squares.

    Args:
        places: float (N, 2), places at rest, pixels.
        moved: float (N, 2), displacements, pixels; NaN for a marker that is not seen.

    Example:
        >>> places = np.array([[0.0, 0], [10, 0], [0, 10], [10, 10]])
        >>> round(marker_motion(places, 0.1 * (places - 5) + [2, 0]).divergence)
        20
    """
    known = np.isfinite(moved).all(1)
    share = float(known.mean()) if len(known) else 0.0
    if known.sum() < _FEWEST or share < _LEAST:
        return Motion(shear=(np.nan, np.nan), torsion=np.nan, divergence=np.nan, seen=share)
    rest, change = np.asarray(places[known], np.float64), np.asarray(moved[known], np.float64)
    x, y = change.mean(0).tolist()
    p = rest - rest.mean(0)
    u = change - change.mean(0)
    q = p + u
    turn = np.arctan2((p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0]).sum(), (p * q).sum())
    gradient, *_ = np.linalg.lstsq(p, u, rcond=None)
    return Motion(
        shear=(x, y),
        torsion=float(np.rad2deg(turn)),
        divergence=100 * float(np.trace(gradient)),
        seen=share,
    )


def displacement_field(
    places: NDArray[np.floating],
    moved: NDArray[np.floating],
    size: tuple[int, int],
    pitch: float,
) -> NDArray[np.float32]:
    """Displacement at a grid over the picture, whatever markers a gel has.

    A cell takes the mean of the markers around its centre, weighted by a Gaussian of .45 pitches.

    Args:
        places: float (N, 2), places at rest, pixels.
        moved: float (N, 2), displacements, pixels; NaN for a marker that is not seen.
        size: Height and width of the picture.
        pitch: Distance of neighbouring markers, pixels.

    Returns:
        float32 (12, 12, 2): rows, columns, and displacement to the right and down, in percent of
        the picture's shorter side; NaN where too few markers are seen.
    """
    known = np.isfinite(moved).all(1)
    if known.sum() < _FEWEST or known.mean() < _LEAST:
        return np.full((*FIELD, 2), np.nan, np.float32)
    height, width = size
    # middles of cells; the first pixel has its middle at 0, so its edge is at -0.5
    y = (np.arange(FIELD[0]) + 0.5) * height / FIELD[0] - 0.5
    x = (np.arange(FIELD[1]) + 0.5) * width / FIELD[1] - 0.5
    cells = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 1, 2)
    far = ((cells - places[known]) ** 2).sum(-1)
    # less that of the nearest: far from all markers, every weight would round to 0
    weight = np.exp(-(far - far.min(1, keepdims=True)) / (2 * (0.45 * pitch) ** 2))
    weight /= weight.sum(1, keepdims=True)
    field = 100 / min(size) * (weight @ np.asarray(moved[known], np.float64))
    out: NDArray[np.float32] = field.reshape(*FIELD, 2).astype(np.float32)
    return out


def draw_arrows(
    picture: NDArray[np.uint8],
    places: NDArray[np.floating],
    moved: NDArray[np.floating],
    scale: float = 4.0,
) -> NDArray[np.uint8]:
    """Draws the displacement of markers over a picture.

    Args:
        picture: uint8 (H, W, 3), RGB.
        places: float (N, 2), places at rest, pixels.
        moved: float (N, 2), displacements, pixels; markers that are not seen are circles.
        scale: Length of an arrow over its displacement.

    Returns:
        uint8 (H, W, 3).
    """
    drawn = picture.copy()
    line = max(1, round(min(picture.shape[:2]) / 200))
    for (x, y), (right, down) in zip(places.tolist(), moved.tolist(), strict=True):
        start = round(x), round(y)
        if np.isfinite(right) and np.isfinite(down):
            end = round(x + scale * right), round(y + scale * down)
            cv2.arrowedLine(drawn, start, end, (255, 255, 0), line, cv2.LINE_AA, tipLength=0.3)
        else:
            cv2.circle(drawn, start, 3 * line, (255, 80, 80), line, cv2.LINE_AA)
    return drawn
