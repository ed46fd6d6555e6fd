"""Indenter geometry: resolution-free height maps from outlines and profiles.

A height is a function of ``x`` (right) and ``y`` (down), both in mm: the height in mm above the
lowest plane of the shape, 0 at the first point of contact, `DEEP` without material.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import reduce
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from tactileforge.errors import ConfigError
from tactileforge_sim.geometry.sdf2d import SDF, Array, circle

Height: TypeAlias = Callable[[Array, Array], Array]
Split: TypeAlias = Literal["pretrain", "bench_train", "bench_test"]

#: Height at which a shape ends, mm; no gel is pressed that far.
DEEP = 4.0
#: Rise of a wall, mm per mm; steep, yet a fine grid samples it without jumps.
STEEP = 6.0
#: Radius of the rounded edge of a 3-D print, mm.
FILLET = 0.2
#: Least width of a shape, cells of a grid; its finest detail spans at least one cell.
CELLS = 4.0
#: Largest distance of any part of a shape from its middle, mm.
REACH = 12.0
#: Margin around a shape's radius, which is measured in steps of 0.1 mm.
_AROUND = 0.3


@dataclass(frozen=True)
class Shape:
    """An indenter, a texture or an object, as seen by the gel.

    Attributes:
        name: Name in options and file names.
        height: Function from x, y (mm) to mm above the tip's lowest plane; `DEEP` without material.
        radius: Half of its size, mm; the height is `DEEP` farther from the middle.
        index: Number in the paper's table of indenters; None for anything else.
        split: Use of the shape: pre-training, or training or testing of the force benchmark.
        round: Whether rotation about the normal changes nothing.
        detail: Width of its finest detail, mm; 0 if unknown.
    """

    name: str
    height: Height
    radius: float
    index: int | None = None
    split: Split = "pretrain"
    round: bool = False
    detail: float = 0.0

    @property
    def words(self) -> str:
        """The shape in plain words, for captions.

        Example:
            >>> Shape("elliptical_13", np.hypot, 5.0, index=13).words
            'elliptical'
        """
        name = self.name if self.index is None else self.name.removesuffix(f"_{self.index}")
        return name.replace("_", " ")

    def map(self, pixels: int, spacing_mm: float) -> NDArray[np.float32]:
        """Samples the height on a square grid, centred on the shape.

        Returns:
            float32 (pixels, pixels), mm; rows along ``y``, columns along ``x``.

        Raises:
            ConfigError: The grid is too coarse for the shape; the message gives the limit.
        """
        limit = 2 * self.radius / CELLS
        if self.detail:
            limit = min(limit, self.detail)
        if not 0 < spacing_mm <= limit:
            raise ConfigError(
                f"shape {self.name!r} is {2 * self.radius:.3g} mm wide"
                f"{f' with details of {self.detail:.3g} mm' if self.detail else ''}: a grid of "
                f"{spacing_mm:.3g} mm does not show it; use a spacing above 0 and at most "
                f"{limit:.3g} mm"
            )
        axis = (np.arange(pixels) - (pixels - 1) / 2) * spacing_mm
        return self.heights(axis).astype(np.float32)

    def heights(self, axis: NDArray[np.floating]) -> Array:
        """Heights on the square grid of the places ``axis`` along x and y, mm (n, n)."""
        # Beyond its radius a shape ends: its outlines are evaluated in the middle only.
        near = np.abs(axis) <= self.radius + _AROUND
        out = np.full((len(axis), len(axis)), DEEP)
        out[np.ix_(near, near)] = self.height(*np.meshgrid(axis[near], axis[near]))
        return out


def shape_of(
    name: str,
    height: Height,
    index: int | None = None,
    split: Split = "pretrain",
    detail: float = 0.0,
) -> Shape:
    """A `Shape` with its lowest point, size and roundness measured from its height."""
    away = np.arange(0.0, REACH + 0.1, 0.1)
    angle = np.radians(np.arange(0.0, 360.0, 3.0))
    # On circles: a shape is round if its height is constant along each of them.
    rho, theta = np.meshgrid(away, angle)
    heights = height(rho * np.cos(theta), rho * np.sin(theta))
    solid = (heights < DEEP).any(0)
    radius = float(away[solid].max(initial=0.0)) + 0.1
    even = bool(np.ptp(heights, 0).max() < 1e-6)
    lowest = float(heights.min())

    def lowered(x: Array, y: Array) -> Array:
        high = height(x, y)
        return np.where(high < DEEP, np.maximum(high - lowest, 0), DEEP)

    given = lowered if lowest > 1e-3 else height
    return Shape(name, given, radius, index, split, even, detail)


def extrude(mask: SDF, fillet: float = FILLET, steep: float = STEEP) -> Height:
    """A flat tip with an outline, a rounded edge, and walls; a disc may be rounded to a ball.

    Args:
        mask: Outline of the tip.
        fillet: Radius of the edge, mm; the edge curves inside the outline.
        steep: Rise of the walls, mm per mm.
    """
    sine = steep / np.hypot(1, steep)
    bend, rise = fillet * sine, fillet * (1 - np.sqrt(1 - sine**2))

    def height(x: Array, y: Array) -> Array:
        into_edge = np.maximum(mask(x, y) + fillet, 0)
        curved = np.minimum(into_edge, bend)
        edge = fillet - np.sqrt(fillet**2 - curved**2)
        wall = rise + steep * (into_edge - bend)
        return np.asarray(np.minimum(np.where(into_edge > bend, wall, edge), DEEP))

    return height


def ball(radius: float) -> Height:
    """A sphere about the origin."""
    return extrude(circle(radius), fillet=radius)


def lift(height: Height, by: float) -> Height:
    """A shape moved back by ``by`` mm, away from the gel."""
    return lambda x, y: np.minimum(height(x, y) + by, DEEP)


def join(*heights: Height) -> Height:
    """The union of shapes, side by side or on each other."""
    return lambda x, y: reduce(np.minimum, (height(x, y) for height in heights))


def pad(relief: Height, radius: float = 7.0, curve: float = 60.0) -> Height:
    """A relief on a round pad, slightly domed: contact grows from the middle.

    Args:
        relief: Depth in mm below the outermost plane, 0 or more.
        radius: Radius of the pad, mm.
        curve: Radius of curvature of the pad, mm.
    """
    edge = extrude(circle(radius), fillet=1.0)

    def height(x: Array, y: Array) -> Array:
        sag = (x**2 + y**2) / (2 * curve)
        return np.minimum(relief(x, y) + sag + edge(x, y), DEEP)

    return height


def rod(radius: float, relief: Height, length: float = 13.0) -> Height:
    """A relief on a lying rod along ``x``; its walls are as steep as any.

    Args:
        radius: Radius of the rod, mm.
        relief: Depth in mm below the rod's surface.
        length: Length of the rod, mm.
    """
    side = extrude(lambda x, y: np.abs(y) - radius, fillet=radius)
    ends = extrude(lambda x, y: np.abs(x) - length / 2)

    def height(x: Array, y: Array) -> Array:
        return np.minimum(side(x, y) + ends(x, y) + relief(x, y), DEEP)

    return height


def printed(
    shape: Shape, period: float = 0.15, amplitude: float = 0.01, angle: float = 45.0
) -> Shape:
    """A shape with the lines of a 3-D print.

    Args:
        shape: Any shape.
        period: Distance of two lines, mm; 0.1 to 0.2 for the layers of real prints, up to 1 for
            their extruded roads.
        amplitude: Depth of the grooves, mm; 0.005 to 0.03 on real prints.
        angle: Direction of the lines, degrees clockwise from the right.

    Raises:
        ConfigError: The period or the amplitude is out of range; the message gives the limit.
    """
    if period <= 0 or not 0 <= amplitude <= period:
        raise ConfigError(
            f"printed lines {period:.3g} mm apart and {amplitude:.3g} mm deep: the period must be "
            "above 0 mm, and the depth between 0 mm and the period"
        )
    sine, cosine = np.sin(np.radians(angle)), np.cos(np.radians(angle))

    def height(x: Array, y: Array) -> Array:
        phase = 2 * np.pi / period * (y * cosine - x * sine)
        return np.asarray(
            np.minimum(shape.height(x, y) + amplitude / 2 * (1 - np.cos(phase)), DEEP)
        )

    return replace(shape, height=height, round=False)
