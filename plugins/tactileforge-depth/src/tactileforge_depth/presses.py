"""Real images of balls pressed into a gel, for fitting calibrations.

The circle of the contact is annotated or detected; the gel's surface around a ball of known radius
follows from the simulator's own contact mechanics.
"""

from __future__ import annotations

import csv
import math
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any, TypeAlias

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from tactileforge.errors import DataError, DataNotFoundError
from tactileforge_depth import contact
from tactileforge_depth.gel import Gel, kernel

Array: TypeAlias = NDArray[Any]

#: Half side of the scored square around a contact, contact radii.
CROP = 1.6


@dataclass(frozen=True)
class Presses:
    """Images of a ball pressed into one sensor.

    Attributes:
        background: float32 (3, H, W), the image with no contact, RGB grey levels.
        pictures: uint8 (N, 3, H, W).
        circles: float32 (N, 3), centre x, centre y and radius of the contacts, pixels.
        spacing: Width of a pixel, mm.
        ball: Radius of the ball, mm; 2.
        thickness: Thickness of the gel, mm; 4.
        share: Radius of the contact over that of its circle in the image; 1.
        steepest: Limit of the lateral length of normals, see `features.normals`; 0.7.
        shadows: Whether the fit uses shadows of the lights; True.
    """

    background: Tensor
    pictures: Tensor
    circles: Tensor
    spacing: float
    ball: float = 2.0
    thickness: float = 4.0
    share: float = 1.0
    steepest: float = 0.7
    shadows: bool = True

    def __len__(self) -> int:
        return len(self.pictures)

    @property
    def size(self) -> tuple[int, int]:
        """Height and width of the images."""
        return self.background.shape[1], self.background.shape[2]

    def part(self, which: slice) -> Presses:
        """Some of the presses."""
        return replace(self, pictures=self.pictures[which], circles=self.circles[which])

    def crop(self, number: int, radii: float = CROP) -> tuple[slice, slice]:
        """Rows and columns of the square within ``radii`` contact radii of a contact's centre."""
        x, y, r = (float(v) for v in self.circles[number])
        low = (max(0, int(v - radii * r)) for v in (y, x))
        high = (max(0, int(v + radii * r)) for v in (y, x))
        rows, columns = (slice(a, b) for a, b in zip(low, high, strict=True))
        return rows, columns

    def dent(self, number: int) -> Tensor:
        """The gel's surface in one press, float32 (1, H, W), mm."""
        x, y, r = (float(v) for v in self.circles[number])
        height, width = self.size
        far = np.hypot(*np.ogrid[-y : height - y, -x : width - x]) * self.spacing
        radii, depths = ball_profile(self.ball, self.thickness, self.share * r * self.spacing)
        return torch.from_numpy(np.interp(far, radii, depths).astype(np.float32))[None]


def ball_profile(
    ball: float, thickness: float, contact_radius: float
) -> tuple[np.ndarray, np.ndarray]:
    """Depth of the gel around a ball in contact within a circle.

    Args:
        ball: Radius of the ball, mm.
        thickness: Thickness of the gel, mm.
        contact_radius: Radius of the contact, mm; clipped to the range of the solved presses.

    Returns:
        Distances from the centre, mm, and depths there, mm.
    """
    presses = _ball_presses(ball, thickness)
    reached = [radius for radius, _ in presses]
    wanted = float(np.clip(contact_radius, reached[0], reached[-1]))
    after = min(max(int(np.searchsorted(reached, wanted)), 1), len(presses) - 1)
    (a, shallow), (b, deep) = presses[after - 1], presses[after]
    share = (wanted - a) / (b - a)
    radii = np.arange(len(shallow)) * _SPACING
    # Stretch both profiles to the same contact circle before mixing: their edges would not meet.
    mixed = (1 - share) * np.interp(radii * a / wanted, radii, shallow)
    return radii, mixed + share * np.interp(radii * b / wanted, radii, deep)


#: Points a side of the solver's grid, their distance (mm), and steps of the depth of presses (mm).
_POINTS, _SPACING, _STEP = 256, 0.06, 0.15


@lru_cache
def _ball_presses(ball: float, thickness: float) -> list[tuple[float, Array]]:
    """Radius of the contact and profile of the gel, for presses of growing depth."""
    axis = (torch.arange(_POINTS) - _POINTS // 2) * _SPACING
    far = torch.hypot(axis[:, None], axis)
    height = torch.where(far < ball, ball - (ball**2 - far**2).clamp(min=0).sqrt(), 4 * ball)
    # Frictionless contact with this Poisson's ratio gives the forces and shapes of the gel's own
    # ratio with friction.
    layer = kernel(Gel(thickness=thickness, poisson=0.49), _POINTS, _SPACING)
    rings = (far / _SPACING).round().long().clamp(max=_POINTS // 2).flatten()
    count = torch.bincount(rings)
    profiles: list[tuple[float, Array]] = []
    pressure = None
    for depth in np.arange(_STEP, 1.8 * ball, _STEP):
        pressure = contact.press(layer, (float(depth) - height)[None], pressure)
        radius = math.sqrt(float((pressure > 0).sum()) / math.pi) * _SPACING
        # Profiles are looked up by the radius, which must grow: deeper presses do not widen it.
        if profiles and radius < profiles[-1][0] + 1e-3:
            break
        total = torch.bincount(rings, weights=layer.press(pressure).flatten())
        profiles.append((radius, (total / count)[:-1].numpy()))
    return profiles


def find_circle(
    picture: Tensor, background: Tensor, share: float = 0.3
) -> tuple[float, float, float]:
    """The contact in an image, as a disc of the area of the largest changed region.

    Args:
        picture: (3, H, W), grey levels.
        background: (3, H, W), the image without contact, grey levels.
        share: Threshold of a changed pixel, as a share of the largest change; 0.3.

    Returns:
        Centre x, centre y and radius, pixels.
    """
    change = (picture.float() - background).abs().mean(0).numpy()
    change = cv2.GaussianBlur(change, (0, 0), 3)
    mask = (change > share * change.max()).astype(np.uint8)
    _, _, regions, centres = cv2.connectedComponentsWithStats(mask)
    largest = 1 + int(regions[1:, cv2.CC_STAT_AREA].argmax())
    x, y = centres[largest]
    return float(x), float(y), math.sqrt(regions[largest, cv2.CC_STAT_AREA] / math.pi)


def read_presses(
    folder: Path,
    background: str,
    spacing: float,
    annotations: str | None = None,
    pictures: str = "*.png",
    **about: Any,
) -> Presses:
    """Reads presses from a folder.

    Args:
        folder: Folder of the images.
        background: Name of the image with no contact.
        spacing: Width of a pixel, mm.
        annotations: Name of a CSV file with the columns file, center_x_px, center_y_px, radius_px;
            None to find the circles in the images.
        pictures: Glob pattern of the files of presses; only used without annotations.
        about: Other fields of `Presses`.

    Raises:
        DataNotFoundError: A file does not exist.
        DataError: A file is not an image.
    """
    still = read_picture(folder / background).float()
    if annotations is None:
        paths = [path for path in sorted(folder.glob(pictures)) if not path.name.startswith(".")]
        shots = torch.stack([read_picture(path) for path in paths])
        circles = [list(find_circle(shot, still)) for shot in shots]
    else:
        with open(folder / annotations, newline="") as table:
            rows = list(csv.DictReader(table))
        shots = torch.stack([read_picture(folder / row["file"]) for row in rows])
        columns = ("center_x_px", "center_y_px", "radius_px")
        circles = [[float(row[c]) for c in columns] for row in rows]
    return Presses(still, shots, torch.tensor(circles), spacing, **about)


#: Presses behind the packaged calibrations: folder, background, and parameters of `read_presses`.
#: The Mini's annotated circles miss the contact by up to a third of their radius, so its circles
#: are detected. Its colours saturate at gentler slopes than those of the other sensors.
KNOWN: dict[str, tuple[str, str, dict[str, Any]]] = {
    "gelsight": (
        "taxim_calibration/gelsight",
        "background.jpg",
        {"spacing": 0.0295, "annotations": "annotations.csv"},
    ),
    "gelsight_mini": (
        "taxim_calibration/gelsight_mini",
        "background.jpg",
        {
            "spacing": 0.0295,
            "pictures": "0*.jpg",
            "share": 0.6,
            "steepest": 0.1,
            "shadows": False,
        },
    ),
    "gelsight_fots": (
        "fots_ball_press",
        "gelsight_background.png",
        {
            "spacing": 1 / 19.6,
            "annotations": "gelsight_annotations.csv",
            "thickness": 8.0,
            "shadows": False,
        },
    ),
    "digit": (
        "fots_ball_press",
        "digit_background.png",
        {"spacing": 1 / 19.6, "pictures": "digit/*.png", "share": 0.6},
    ),
}


def read_known(name: str, data: Path) -> Presses:
    """The presses behind a packaged calibration, from the folder of all real data."""
    folder, background, about = KNOWN[name]
    return read_presses(data / folder, background, **about)


def read_picture(path: Path) -> Tensor:
    """Reads an image, uint8 (3, H, W), RGB.

    Raises:
        DataNotFoundError: The file does not exist.
        DataError: The file is not an image.
    """
    if not path.is_file():
        raise DataNotFoundError(f"{path} does not exist; give the folder of the ball presses")
    picture = cv2.imread(str(path), cv2.IMREAD_COLOR | cv2.IMREAD_ANYDEPTH)
    if picture is None:
        raise DataError(f"{path} is not an image")
    if picture.dtype != np.uint8:
        raise DataError(f"{path}: {picture.dtype} pixels; convert it to 8 bits a channel")
    return torch.from_numpy(picture[..., ::-1].copy()).permute(2, 0, 1)
