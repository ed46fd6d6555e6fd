"""Fits calibrations on real images of balls pressed into a gel.

The gel's surface in each press is known (see `presses`). The remaining problem is linear: grey
levels from features of the surface and the place.
"""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from pathlib import Path

import torch
import torch.nn.functional as F
from torch import Tensor

from tactileforge.plugins import write_text
from tactileforge_depth.features import POWERS, Coarse, fine, normals, places
from tactileforge_depth.lighting import DEGREE, OpticalCalibration
from tactileforge_depth.presses import Presses

#: Half side of the fitted square around a contact, contact radii.
_AROUND = 3.0
#: Penalty of a weight, see `fit_weights`; and its factor for weights that vary with the place.
_RIDGE = 1e-4
_PLACE = 10.0
#: Degree of the polynomials of backgrounds.
_GROUND = 6


def press_features(presses: Presses, lights: Sequence[float]) -> list[Tensor]:
    """All features of each press at the image's resolution, float32 (K, H, W)."""
    coarse = Coarse(presses.size, presses.spacing, lights)
    out = []
    for number in range(len(presses)):
        dent = presses.dent(number)
        smooth = coarse.enlarge(coarse(dent))[0]
        sharp = torch.cat(fine(*normals(dent, presses.spacing, presses.steepest)))
        out.append(torch.cat([sharp, smooth]))
    return out


def fit_weights(
    presses: Presses, maps: Sequence[Tensor], degree: int, ridge: float = _RIDGE
) -> Tensor:
    """Least-squares weights from features and places to the change of the image.

    Args:
        presses: The N presses.
        maps: Features of the presses, N tensors float32 (K, H, W).
        degree: Degree of the polynomials of the place.
        ridge: Penalty of a weight, as a share of its squared largest effect in every pixel.

    Returns:
        float32 (K, P, 3).
    """
    ground = places(*presses.size, degree)
    terms = len(maps[0]) * len(ground)
    left, right = torch.zeros(terms, terms).double(), torch.zeros(terms, 3).double()
    largest, pixels = torch.zeros(len(maps[0])).double(), 0
    for number, feature in enumerate(maps):
        rows, columns = presses.crop(number, _AROUND)
        change = presses.pictures[number, :, rows, columns] - presses.background[:, rows, columns]
        seen = feature[:, rows, columns][..., ::2, ::2].flatten(1)
        place = ground[:, rows, columns][..., ::2, ::2].flatten(1)
        matrix = (seen[:, None] * place).flatten(0, 1).double()
        left += matrix @ matrix.T
        right += matrix @ change[:, ::2, ::2].flatten(1).T.double()
        largest = torch.maximum(largest, seen.double().square().amax(1))
        pixels += seen.shape[1]
    # The presses do not reach steep slopes and the image's corners. So that the fit stays small
    # there, a weight costs by its effect at the feature's largest value and all over the image.
    order = torch.tensor([i + j for i, j in POWERS])[: len(largest)]
    largest[: len(order)] = presses.steepest ** (2.0 * order)
    cost = ground.square().mean((1, 2)).double() * _PLACE
    cost[0] = 1
    weight = pixels * (largest[:, None] * cost).flatten() + 1e-9 * left.trace() / len(left)
    solved: Tensor = torch.linalg.solve(left + ridge * weight.diag(), right)
    return solved.view(-1, len(ground), 3).float()


def fit_optics(presses: Presses, ridge: float = _RIDGE) -> OpticalCalibration:
    """The calibration of a sensor from presses of a ball.

    A light's direction is the average direction of slopes bright in its colour.

    Args:
        presses: Presses of a ball.
        ridge: Penalty of a weight, see `fit_weights`.
    """
    slopes = [feature[:2] for feature in press_features(presses, ())]
    weights = fit_weights(presses, slopes, 0, 0)[:, 0]
    lights = tuple(torch.atan2(-weights[1], -weights[0]).tolist()) if presses.shadows else ()
    maps = press_features(presses, lights)
    weights = fit_weights(presses, maps, DEGREE, ridge)
    peak = torch.stack([feature[len(POWERS) :].abs().amax((1, 2)) for feature in maps]).amax(0)
    return OpticalCalibration(
        fine=weights[: len(POWERS)],
        coarse=weights[len(POWERS) :],
        limits=1.2 * peak,
        steepest=presses.steepest,
        lights=lights,
        backgrounds=fit_background(presses.background)[None],
        noise=camera_noise(presses),
    )


def fit_background(picture: Tensor) -> Tensor:
    """A background (3, H, W) as polynomials of the place, float32 (Q, 3)."""
    ground = places(picture.shape[1], picture.shape[2], _GROUND).flatten(1)[:, ::7]
    weights: Tensor = torch.linalg.lstsq(ground.T, picture.flatten(1)[:, ::7].T).solution
    return weights


def camera_noise(presses: Presses) -> float:
    """Standard deviation of the camera's noise, from differences between neighbouring pixels."""
    change = presses.pictures.float() - presses.background
    # 1.4826 turns a median deviation into a standard one. The mean of 3 x 3 pixels holds a ninth of
    # the pixel itself, so the difference has 8/9 of its variance; a frame and background have two.
    rough = change - F.avg_pool2d(change, 3, 1, 1)
    return float(rough.abs().median()) * 1.4826 * math.sqrt(9 / 8 / 2)


def save_optics(calibration: OpticalCalibration, path: Path, source: str) -> None:
    """Writes a calibration as JSON, with the source of its numbers."""
    fields = {
        "source": source,
        "noise": round(calibration.noise, 3),
        "lights": [round(light, 4) for light in calibration.lights],
        "steepest": calibration.steepest,
        "limits": _short(calibration.limits),
        "fine": _short(calibration.fine),
        "coarse": _short(calibration.coarse),
        "backgrounds": _short(calibration.backgrounds),
    }
    write_text(path, json.dumps(fields, indent=1).replace(",\n      ", ", ") + "\n")


def _short(values: Tensor) -> object:
    if values.ndim > 1:
        return [_short(value) for value in values]
    return [float(f"{value:.5g}") for value in values.tolist()]
