"""Optical calibrations: the response of a sensor's image to the surface of its gel.

The packaged calibrations are fitted on real presses of balls (see `fit`); `lamp_calibration`
computes one from lamps.
"""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from importlib.resources import files

import torch
from torch import Tensor

from tactileforge.contracts import Lamp
from tactileforge.errors import ConfigError, unknown
from tactileforge_depth.features import BLURS, POWERS, exponents, fine, places

#: Degree of the weights as polynomials of the place.
DEGREE = 2


@dataclass(frozen=True)
class OpticalCalibration:
    """Response of a sensor's image to the surface of its gel, at any image size.

    Attributes:
        fine: float32 (len(POWERS), P, 3), grey levels for each feature of the normal, polynomial
            of the place, and colour.
        coarse: float32 (3 len(BLURS) + lights, P, 3), the same for the coarse features.
        limits: float32 (3 len(BLURS) + lights,), saturation of the coarse features, just above
            their largest values in the calibration's data.
        steepest: Limit of the lateral length of normals, see `features.normals`.
        lights: Directions of the shadow-casting lights, rad, clockwise from the right.
        backgrounds: float32 (N, Q, 3), images with no contact as polynomials of the place.
        noise: Standard deviation of the camera's noise, grey levels.
    """

    fine: Tensor
    coarse: Tensor
    limits: Tensor
    steepest: float
    lights: tuple[float, ...]
    backgrounds: Tensor
    noise: float

    def mirrored(self) -> OpticalCalibration:
        """The calibration of the left-right mirrored sensor."""
        # Odd powers of x change their sign in a mirror, as do slopes to the right.
        place = torch.tensor([(-1.0) ** i for i, _ in exponents(DEGREE)])[:, None]
        power = torch.tensor([(-1.0) ** i for i, _ in POWERS])[:, None, None]
        smooth = torch.tensor([-1.0, 1, 1] * len(BLURS) + [1.0] * len(self.lights))[:, None, None]
        degree = _degree(self.backgrounds.shape[1])
        ground = torch.tensor([(-1.0) ** i for i, _ in exponents(degree)])[:, None]
        return replace(
            self,
            fine=self.fine * place * power,
            coarse=self.coarse * place * smooth,
            lights=tuple(math.pi - light for light in self.lights),
            backgrounds=self.backgrounds * ground,
        )

    def turned(self, angles: Sequence[float]) -> OpticalCalibration:
        """The calibration of a sensor with the light of each colour from a turned direction.

        Args:
            angles: Turns of the R, G and B lights, rad, clockwise in the image.
        """
        fine = torch.stack(
            [
                torch.einsum("jk,kp->jp", _turning(angle), self.fine[..., channel])
                for channel, angle in enumerate(angles)
            ],
            -1,
        )
        # Of the three features of a blur, the two slopes turn as a vector; the bulge does not.
        slopes = [i for blur in range(len(BLURS)) for i in (3 * blur, 3 * blur + 1)]
        coarse = self.coarse.clone()
        for channel, angle in enumerate(angles):
            cos, sin = math.cos(angle), math.sin(angle)
            right, down = (
                self.coarse[slopes[::2], :, channel],
                self.coarse[slopes[1::2], :, channel],
            )
            coarse[slopes[::2], :, channel] = cos * right - sin * down
            coarse[slopes[1::2], :, channel] = sin * right + cos * down
        return replace(self, fine=fine, coarse=coarse)

    def contrasted(self, gain: float) -> OpticalCalibration:
        """The calibration of a sensor with the image's change multiplied by ``gain``."""
        return replace(self, fine=gain * self.fine, coarse=gain * self.coarse)

    def shadowed(self, darker: float) -> OpticalCalibration:
        """The calibration of a sensor with shadows ``darker`` times as dark."""
        coarse = self.coarse.clone()
        coarse[3 * len(BLURS) :] *= darker
        return replace(self, coarse=coarse)

    def scattered(self, share: float) -> OpticalCalibration:
        """The calibration of a sensor with ``share`` of the light scattered in its gel."""
        coarse = self.coarse.clone()
        coarse[: 3 * len(BLURS)] *= share
        return replace(self, coarse=coarse)

    def coloured(self, mixing: Tensor) -> OpticalCalibration:
        """The calibration of a sensor with other colours: channels are mixed by a matrix (3, 3)."""
        return replace(self, fine=self.fine @ mixing.T, coarse=self.coarse @ mixing.T)


@lru_cache(maxsize=64)
def _turning(angle: float) -> Tensor:
    """Rotation matrix for weights of `features.fine`, float32 (len(POWERS), len(POWERS)).

    A light turned by ``angle`` sees a normal as the old light sees the normal turned back. A turn
    maps powers of one degree to powers of the same degree, so a few normals determine the matrix.
    """
    grid = torch.linspace(-0.6, 0.6, 9, dtype=torch.float64)
    x, y = (n.flatten() for n in torch.meshgrid(grid, grid, indexing="xy"))
    cos, sin = math.cos(angle), math.sin(angle)
    seen = torch.stack(fine(cos * x + sin * y, cos * y - sin * x), 1)
    turned: Tensor = torch.linalg.lstsq(torch.stack(fine(x, y), 1), seen).solution
    return turned.float()


def polynomial_background(coefficients: Tensor, height: int, width: int) -> Tensor:
    """A background, float32 (3, H, W) in grey levels, of polynomials (Q, 3) of the place."""
    ground = places(height, width, _degree(len(coefficients)))
    return torch.einsum("qc,qhw->chw", coefficients, ground)


def _degree(terms: int) -> int:
    return (math.isqrt(8 * terms + 1) - 3) // 2


def load_optics(name: str) -> OpticalCalibration:
    """A calibration of the package by name.

    Raises:
        ConfigError: The name is unknown; the message lists the known ones.
    """
    known = optics_names()
    if name not in known:
        raise ConfigError(unknown("calibration", name, known))
    return _load(name)


def optics_names() -> list[str]:
    """Names of the package's calibrations, sorted."""
    entries = (files("tactileforge_depth") / "calibration").iterdir()
    return sorted(
        item.name.removesuffix(".json") for item in entries if item.name.endswith(".json")
    )


@lru_cache
def _load(name: str) -> OpticalCalibration:
    return parse_optics((files("tactileforge_depth") / "calibration" / f"{name}.json").read_text())


def parse_optics(text: str) -> OpticalCalibration:
    """A calibration from the JSON text of `fit.save_optics`."""
    data = json.loads(text)
    return OpticalCalibration(
        fine=torch.tensor(data["fine"]),
        coarse=torch.tensor(data["coarse"]),
        limits=torch.tensor(data["limits"]),
        steepest=data["steepest"],
        lights=tuple(data["lights"]),
        backgrounds=torch.tensor(data["backgrounds"]),
        noise=data["noise"],
    )


def lamp_calibration(
    lamps: Sequence[Lamp], base: Sequence[float], dim: float = 0.0, noise: float = 1.5
) -> OpticalCalibration:
    """The calibration of a matt gel from its lamps, their shadows included.

    Args:
        lamps: The lights.
        base: R, G, B of the ambient light, grey levels.
        dim: Loss of ambient light at the middle of the image's sides, as a share.
        noise: Standard deviation of the camera's noise, grey levels.
    """
    grid = torch.linspace(-0.95, 0.95, 39, dtype=torch.float64)
    x, y = (n.flatten() for n in torch.meshgrid(grid, grid, indexing="xy"))
    x, y = (n[torch.hypot(x, y) < 0.95] for n in (x, y))
    powers = torch.stack(fine(x, y), 1)
    terms = exponents(DEGREE)
    shade = torch.zeros(len(POWERS), len(terms), 3)
    smooth = torch.zeros(3 * len(BLURS) + len(lamps), len(terms), 3)
    ground = torch.zeros(len(terms), 3)
    ground[terms.index((0, 0))] = torch.tensor(base)
    for number, lamp in enumerate(lamps):
        cos, sin = math.cos(lamp.elevation), math.sin(lamp.elevation)
        right, down = math.cos(lamp.azimuth), math.sin(lamp.azimuth)
        facing = (1 - x * x - y * y).sqrt() * sin - (x * right + y * down) * cos
        change = torch.linalg.lstsq(powers, facing.clamp(min=0)[:, None] - sin).solution
        change = change.float().round(decimals=4)  # the last digits of lstsq differ from run to run
        colour = torch.tensor(lamp.colour)
        place = torch.zeros(len(terms), 1)
        for term, part in (((0, 0), 1.0), ((1, 0), right * lamp.fall), ((0, 1), down * lamp.fall)):
            place[terms.index(term)] = part
        shade += change[:, :, None] * place * colour
        smooth[3 * len(BLURS) + number] = -lamp.shadow * place * colour
        ground += sin * place * colour
    for term in ((2, 0), (0, 2)):
        ground[terms.index(term)] -= dim * ground[terms.index((0, 0))]
    return OpticalCalibration(
        fine=shade,
        coarse=smooth,
        limits=torch.full((len(smooth),), 1.0),
        steepest=1.0,
        lights=tuple(lamp.azimuth for lamp in lamps),
        backgrounds=ground[None],
        noise=noise,
    )
