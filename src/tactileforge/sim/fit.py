"""Fits calibrations on real pictures of balls pressed into a gel.

The circle of the contact is known, or found; the gel's surface around a ball of known radius
follows from the same contact mechanics that the simulator uses. What is left is linear: grey levels
from features of the surface and the place.
"""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any, TypeAlias

import cv2
import numpy as np
import torch
import torch.nn.functional as F
from numpy.typing import NDArray
from torch import Tensor

from tactileforge.errors import DataError, DataNotFoundError
from tactileforge.sim import contact
from tactileforge.sim.features import POWERS, Coarse, fine, normals, places
from tactileforge.sim.gel import Gel, kernel
from tactileforge.sim.lighting import DEGREE, Calibration

Array: TypeAlias = NDArray[Any]

#: A fit looks at a square of this many contact radii around the contact, a score at `CROP`.
_AROUND = 3.0
CROP = 1.6
_RIDGE = 1e-4
_PLACE = 10.0
#: Degree of the polynomials that backgrounds are.
_GROUND = 6


@dataclass(frozen=True)
class Presses:
    """Pictures of a ball pressed into one sensor.

    Attributes:
        background: float32 (3, H, W), the picture with no contact, RGB grey levels.
        pictures: uint8 (N, 3, H, W).
        circles: float32 (N, 3), centre x, centre y and radius of the contacts, pixels.
        spacing: mm per pixel.
        ball: Radius of the ball, mm.
        thickness: Of the gel, mm.
        share: Radius of the contact over that of the circle that was seen.
        steepest: See `features.normals`.
        shadows: Whether lights cast shadows that the fit can use.
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
        """Height and width of the pictures."""
        return self.background.shape[1], self.background.shape[2]

    def part(self, which: slice) -> Presses:
        """Some of the presses."""
        return replace(self, pictures=self.pictures[which], circles=self.circles[which])

    def crop(self, number: int, radii: float = CROP) -> tuple[slice, slice]:
        """Rows and columns of the square of so many contact radii around a contact."""
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
    """Depth of the gel around a ball that touches it within a circle.

    Args:
        ball: Radius of the ball, mm.
        thickness: Of the gel, mm.
        contact_radius: mm; more than the deepest press that was solved gives that one.

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
    # Profiles are mixed after their contacts are stretched to the same circle.
    mixed = (1 - share) * np.interp(radii * a / wanted, radii, shallow)
    return radii, mixed + share * np.interp(radii * b / wanted, radii, deep)


_POINTS, _SPACING, _STEP = 256, 0.06, 0.15


@lru_cache
def _ball_presses(ball: float, thickness: float) -> list[tuple[float, Array]]:
    """Radius of the contact and profile of the gel, for presses of growing depth."""
    axis = (torch.arange(_POINTS) - _POINTS // 2) * _SPACING
    far = torch.hypot(axis[:, None], axis)
    height = torch.where(far < ball, ball - (ball**2 - far**2).clamp(min=0).sqrt(), 4 * ball)
    layer = kernel(Gel(thickness=thickness), _POINTS, _SPACING)
    rings = (far / _SPACING).round().long().clamp(max=_POINTS // 2).flatten()
    count = torch.bincount(rings)
    found: list[tuple[float, Array]] = []
    pressure = None
    for depth in np.arange(_STEP, 1.8 * ball, _STEP):
        pressure = contact.press(layer, (float(depth) - height)[None], pressure)
        radius = math.sqrt(float((pressure > 0).sum()) / math.pi) * _SPACING
        if found and radius < found[-1][0] + 1e-3:
            break
        total = torch.bincount(rings, weights=layer.press(pressure).flatten())
        found.append((radius, (total / count)[:-1].numpy()))
    return found


def features(presses: Presses, lights: Sequence[float]) -> list[Tensor]:
    """All features of each press at the picture's resolution, float32 (K, H, W)."""
    coarse = Coarse(presses.size, presses.spacing, lights)
    out = []
    for number in range(len(presses)):
        dent = presses.dent(number)
        smooth = coarse.enlarge(coarse(dent))[0]
        sharp = torch.cat(fine(*normals(dent, presses.spacing, presses.steepest)))
        out.append(torch.cat([sharp, smooth]))
    return out


def weigh(presses: Presses, found: Sequence[Tensor], degree: int, ridge: float = _RIDGE) -> Tensor:
    """Least-squares weights from features and places to the change of the picture.

    Args:
        presses: N presses.
        found: N times float32 (K, H, W), their features.
        degree: Of the polynomials of the place.
        ridge: What a weight costs, as a share of what its largest effect costs in every pixel.

    Returns:
        float32 (K, P, 3).
    """
    ground = places(*presses.size, degree)
    terms = len(found[0]) * len(ground)
    left, right = torch.zeros(terms, terms).double(), torch.zeros(terms, 3).double()
    largest, pixels = torch.zeros(len(found[0])).double(), 0
    for number, feature in enumerate(found):
        rows, columns = presses.crop(number, _AROUND)
        change = presses.pictures[number, :, rows, columns] - presses.background[:, rows, columns]
        seen = feature[:, rows, columns][..., ::2, ::2].flatten(1)
        place = ground[:, rows, columns][..., ::2, ::2].flatten(1)
        matrix = (seen[:, None] * place).flatten(0, 1).double()
        left += matrix @ matrix.T
        right += matrix @ change[:, ::2, ::2].flatten(1).T.double()
        largest = torch.maximum(largest, seen.double().square().amax(1))
        pixels += seen.shape[1]
    # What the presses did not reach, steep slopes and corners of the picture, stays tame: a weight
    # costs by what it does where its feature is largest, and all over the picture.
    order = torch.tensor([i + j for i, j in POWERS])[: len(largest)]
    largest[: len(order)] = presses.steepest ** (2.0 * order)
    cost = ground.square().mean((1, 2)).double() * _PLACE
    cost[0] = 1
    weight = pixels * (largest[:, None] * cost).flatten() + 1e-9 * left.trace() / len(left)
    solved: Tensor = torch.linalg.solve(left + ridge * weight.diag(), right)
    return solved.view(-1, len(ground), 3).float()


def fit(presses: Presses) -> Calibration:
    """The calibration of a sensor from presses of a ball.

    Lights are where each colour's slope is bright, on average.
    """
    slopes = [feature[:2] for feature in features(presses, ())]
    weights = weigh(presses, slopes, 0, 0)[:, 0]
    lights = tuple(torch.atan2(-weights[1], -weights[0]).tolist()) if presses.shadows else ()
    found = features(presses, lights)
    weights = weigh(presses, found, DEGREE)
    peak = torch.stack([feature[len(POWERS) :].abs().amax((1, 2)) for feature in found]).amax(0)
    return Calibration(
        fine=weights[: len(POWERS)],
        coarse=weights[len(POWERS) :],
        limits=1.2 * peak,
        steepest=presses.steepest,
        lights=lights,
        backgrounds=fit_background(presses.background)[None],
        noise=noise(presses),
    )


def fit_background(picture: Tensor) -> Tensor:
    """A background (3, H, W) as polynomials of the place, float32 (Q, 3)."""
    ground = places(picture.shape[1], picture.shape[2], _GROUND).flatten(1)[:, ::7]
    found: Tensor = torch.linalg.lstsq(ground.T, picture.flatten(1)[:, ::7].T).solution
    return found


def noise(presses: Presses) -> float:
    """Standard deviation of the camera's noise: what neighbouring pixels do not share."""
    change = presses.pictures.float() - presses.background
    rough = change - F.avg_pool2d(change, 3, 1, 1)
    return float(rough.abs().median()) * 1.4826 * math.sqrt(9 / 8 / 2)


def save(calibration: Calibration, path: Path, source: str) -> None:
    """Writes a calibration as JSON, with where its numbers come from."""
    held = {
        "source": source,
        "noise": round(calibration.noise, 3),
        "lights": [round(light, 4) for light in calibration.lights],
        "steepest": calibration.steepest,
        "limits": _short(calibration.limits),
        "fine": _short(calibration.fine),
        "coarse": _short(calibration.coarse),
        "backgrounds": _short(calibration.backgrounds),
    }
    path.write_text(json.dumps(held, indent=1).replace(",\n      ", ", ") + "\n")


def _short(values: Tensor) -> object:
    if values.ndim > 1:
        return [_short(value) for value in values]
    return [float(f"{value:.5g}") for value in values.tolist()]


def find_circle(
    picture: Tensor, background: Tensor, share: float = 0.3
) -> tuple[float, float, float]:
    """The contact in a picture: the disc as large as the largest region that changed.

    Args:
        picture: (3, H, W), grey levels.
        background: (3, H, W).
        share: Of the largest change, what counts as changed.

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
        folder: Holds the pictures.
        background: Name of the picture with no contact.
        spacing: mm per pixel.
        annotations: Name of a CSV file with the columns file, center_x_px, center_y_px, radius_px;
            None to find the circles in the pictures.
        pictures: Which files are presses, where there are no annotations.
        about: More of the `Presses`.

    Raises:
        DataNotFoundError: A file does not exist.
        DataError: A file is no picture.
    """
    still = read_picture(folder / background).float()
    if annotations is None:
        shots = torch.stack([read_picture(path) for path in sorted(folder.glob(pictures))])
        circles = [list(find_circle(shot, still)) for shot in shots]
    else:
        with open(folder / annotations, newline="") as table:
            rows = list(csv.DictReader(table))
        shots = torch.stack([read_picture(folder / row["file"]) for row in rows])
        columns = ("center_x_px", "center_y_px", "radius_px")
        circles = [[float(row[c]) for c in columns] for row in rows]
    return Presses(still, shots, torch.tensor(circles), spacing, **about)


#: Where the presses lie that the shipped calibrations are fitted on, and what is known of them.
#: Annotations of the Mini miss the contact by up to a third of its radius: circles are found.
KNOWN: dict[str, tuple[str, str, dict[str, Any]]] = {
    "gelsight": (
        "taxim_calibration/gelsight",
        "background.jpg",
        {"spacing": 0.0295, "annotations": "annotations.csv"},
    ),
    "gelsight_mini": (
        "taxim_calibration/gelsight_mini",
        "background.jpg",
        {"spacing": 0.0295, "pictures": "0*.jpg", "share": 0.5, "steepest": 0.35, "shadows": False},
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
    """The presses of a calibration that ships, from the folder of all real data."""
    folder, background, about = KNOWN[name]
    return read_presses(data / folder, background, **about)


def read_picture(path: Path) -> Tensor:
    """A picture, uint8 (3, H, W), RGB.

    Raises:
        DataNotFoundError: The file does not exist.
        DataError: It is no picture.
    """
    if not path.is_file():
        raise DataNotFoundError(f"{path} does not exist; give the folder of the ball presses")
    picture = cv2.imread(str(path))
    if picture is None:
        raise DataError(f"{path} is no picture")
    return torch.from_numpy(picture[..., ::-1].copy()).permute(2, 0, 1)
