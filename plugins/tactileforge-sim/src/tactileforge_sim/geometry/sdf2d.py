"""Flat outlines as signed distances of a point from the edge, mm, negative inside.

An outline is a function of ``x`` (right) and ``y`` (down), both arrays in mm. Sizes are in mm,
angles in degrees, positive angles clockwise in the image. Outlines are independent of pixels, and
so sharp at any resolution.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import reduce
from itertools import pairwise
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

Array: TypeAlias = NDArray[np.float64]
SDF: TypeAlias = Callable[[Array, Array], Array]
Point: TypeAlias = tuple[float, float]


def circle(radius: float) -> SDF:
    """A disc about the origin.

    Example:
        >>> circle(2.0)(np.array([3.0]), np.array([0.0]))
        array([1.])
    """
    return lambda x, y: np.hypot(x, y) - radius


def ellipse(half_width: float, half_height: float) -> SDF:
    """An ellipse; its nearest point is found by its centre of curvature, in four rounds."""
    a, b = half_width, half_height

    def distance(x: Array, y: Array) -> Array:
        px, py = np.abs(x), np.abs(y)
        tx = ty = np.full(x.shape, np.sqrt(0.5))
        for _ in range(4):
            ex, ey = (a * a - b * b) / a * (tx * tx * tx), (b * b - a * a) / b * (ty * ty * ty)
            reach = np.hypot(a * tx - ex, b * ty - ey) / (np.hypot(px - ex, py - ey) + 1e-12)
            tx = np.clip(((px - ex) * reach + ex) / a, 0, 1)
            ty = np.clip(((py - ey) * reach + ey) / b, 0, 1)
            length = np.hypot(tx, ty) + 1e-12
            tx, ty = tx / length, ty / length
        away = np.hypot(a * tx - px, b * ty - py)
        return np.asarray(np.where((x / a) ** 2 + (y / b) ** 2 < 1, -away, away))

    return distance


def box(width: float, height: float) -> SDF:
    """A rectangle about the origin."""

    def distance(x: Array, y: Array) -> Array:
        dx, dy = np.abs(x) - width / 2, np.abs(y) - height / 2
        outside = np.hypot(np.maximum(dx, 0), np.maximum(dy, 0))
        return outside + np.minimum(np.maximum(dx, dy), 0)

    return distance


def polygon(*corners: Point) -> SDF:
    """A polygon from its corners in order; it may have dents, but no crossing edges."""
    edges = list(zip(corners, corners[1:] + corners[:1], strict=True))

    def distance(x: Array, y: Array) -> Array:
        nearest = np.full(x.shape, np.inf)
        inside = np.zeros(x.shape, dtype=bool)
        for (ax, ay), (bx, by) in edges:
            nearest = np.minimum(nearest, _squared(x, y, (ax, ay), (bx, by)))
            # Even-odd rule: each edge that a ray to the right crosses toggles inside and outside.
            if ay != by:
                crosses = ((ay > y) != (by > y)) & (x < ax + (y - ay) * (bx - ax) / (by - ay))
                inside ^= crosses
        away = np.sqrt(nearest)
        return np.asarray(np.where(inside, -away, away))

    return distance


def regular(corners: int, radius: float) -> SDF:
    """A regular polygon with one corner at the top, from its circumscribed radius."""
    return polygon(*_turned(corners, [(0.0, -radius)]))


def star(points: int, outer: float, inner: float) -> SDF:
    """A star with one point at the top, from the radii of its points and of its dents."""
    half = np.pi / points
    return polygon(*_turned(points, [(0.0, -outer), (inner * np.sin(half), -inner * np.cos(half))]))


def sector(radius: float, angle: float) -> SDF:
    """A slice of a disc, tip at the origin, open towards the top."""
    half = np.radians(angle / 2)
    sine, cosine = np.sin(half), np.cos(half)

    def distance(x: Array, y: Array) -> Array:
        side, up = np.abs(x), -y
        along = np.clip(side * sine + up * cosine, 0, radius)
        straight = np.hypot(side - along * sine, up - along * cosine)
        turned = side * cosine - up * sine
        return np.asarray(np.maximum(np.hypot(x, y) - radius, straight * np.sign(turned)))

    return distance


def stroke(width: float, *points: Point) -> SDF:
    """A line of a width through points, with round ends."""
    pieces = list(pairwise(points))

    def distance(x: Array, y: Array) -> Array:
        nearest = reduce(np.minimum, (_squared(x, y, a, b) for a, b in pieces))
        return np.sqrt(nearest) - width / 2

    return distance


def arc(width: float, radius: float, start: float, stop: float) -> SDF:
    """A bent stroke about the origin; angles are clockwise from the right."""
    middle, half = np.radians((start + stop) / 2), np.radians((stop - start) / 2)
    end = (radius * np.cos(half), radius * np.sin(half))

    def distance(x: Array, y: Array) -> Array:
        u = x * np.cos(middle) + y * np.sin(middle)
        v = np.abs(y * np.cos(middle) - x * np.sin(middle))
        on_arc = np.arctan2(v, u) <= half
        body = np.abs(np.hypot(u, v) - radius)
        return np.asarray(np.where(on_arc, body, np.hypot(u - end[0], v - end[1])) - width / 2)

    return distance


def wavy(radius: float, wave: float, count: int) -> SDF:
    """A disc with ``count`` waves on its edge; the distance is exact to first order."""

    def distance(x: Array, y: Array) -> Array:
        away, angle = np.hypot(x, y), count * np.arctan2(y, x)
        # Division by the length of the gradient makes the level function a distance near the edge.
        slope = wave * count * np.sin(angle) / np.maximum(away, radius / 2)
        return np.asarray((away - radius - wave * np.cos(angle)) / np.hypot(1, slope))

    return distance


def union(*masks: SDF) -> SDF:
    """The union of outlines."""
    return lambda x, y: reduce(np.minimum, (mask(x, y) for mask in masks))


def minus(mask: SDF, *holes: SDF) -> SDF:
    """An outline with holes."""
    return lambda x, y: reduce(np.maximum, (-hole(x, y) for hole in holes), mask(x, y))


def both(*masks: SDF) -> SDF:
    """The intersection of outlines."""
    return lambda x, y: reduce(np.maximum, (mask(x, y) for mask in masks))


def grow(mask: SDF, by: float) -> SDF:
    """An outline moved outwards by ``by`` mm on every side."""
    return lambda x, y: mask(x, y) - by


def at(x0: float, y0: float, mask: SDF) -> SDF:
    """An outline moved to a point."""
    return lambda x, y: mask(x - x0, y - y0)


def turn(angle: float, mask: SDF) -> SDF:
    """An outline turned about the origin, clockwise."""
    cosine, sine = np.cos(np.radians(angle)), np.sin(np.radians(angle))
    return lambda x, y: mask(x * cosine + y * sine, y * cosine - x * sine)


def grid(columns: int, rows: int, pitch: float | Point, mask: SDF) -> SDF:
    """Copies in columns and rows about the origin; a copy must fit in its cell."""
    px, py = (pitch, pitch) if isinstance(pitch, int | float) else pitch

    def distance(x: Array, y: Array) -> Array:
        return reduce(
            np.minimum,
            (mask(u, v) for u in _cells(x, columns, px) for v in _cells(y, rows, py)),
        )

    return distance


def around(count: int, radius: float, mask: SDF) -> SDF:
    """Copies on a circle, the first at the top; each keeps its own top outwards."""
    step = 360 / count

    def distance(x: Array, y: Array) -> Array:
        # The two nearest copies are enough: the one of this slice, and the one on its other side.
        place = np.degrees(np.arctan2(x, -y)) / step
        first = np.round(place)
        second = first + np.where(place >= first, 1, -1)
        return np.minimum(_outward(mask, x, y, first), _outward(mask, x, y, second))

    def _outward(mask: SDF, x: Array, y: Array, slot: Array) -> Array:
        cosine, sine = np.cos(np.radians(slot * step)), np.sin(np.radians(slot * step))
        return mask(x * cosine + y * sine, y * cosine - x * sine + radius)

    return distance


def ring(outer: float, inner: float) -> SDF:
    """A flat ring, from its two radii."""
    return minus(circle(outer), circle(inner))


def trapezoid(top: float, bottom: float, height: float) -> SDF:
    """An isosceles trapezoid about the origin; widths of its top and bottom."""
    h = height / 2
    return polygon((-top / 2, -h), (top / 2, -h), (bottom / 2, h), (-bottom / 2, h))


def tee(size: float, thick: float) -> SDF:
    """A letter T in a square of side ``size``, of strokes ``thick`` wide."""
    bar = at(0, (thick - size) / 2, box(size, thick))
    return union(bar, box(thick, size))


def cross(size: float, thick: float) -> SDF:
    """An upright cross in a square of side ``size``, of strokes ``thick`` wide."""
    return union(box(size, thick), box(thick, size))


def crescent(radius: float, bite: float, shift: float) -> SDF:
    """A moon: a disc less a disc of radius ``bite``, moved right by ``shift``."""
    return minus(circle(radius), at(shift, 0, circle(bite)))


def teardrop(radius: float, length: float) -> SDF:
    """A drop: a disc with a tip at the top, ``length`` above the disc's middle."""
    sine = radius / length
    x, y = radius * np.sqrt(1 - sine**2), -radius * sine
    return union(circle(radius), polygon((0.0, -length), (x, y), (0.0, 0.0), (-x, y)))


def heart(size: float) -> SDF:
    """A heart, tip at the bottom: a square on its corner with a disc on two of its sides."""
    side = size * 0.6
    half = side / 2
    lobes = (at(0, -half, circle(half)), at(half, 0, circle(half)))
    return at(0, -size / 20, turn(-45, union(box(side, side), *lobes)))


def _squared(x: Array, y: Array, a: Point, b: Point) -> Array:
    """Squared distance to the line from a to b."""
    ex, ey = b[0] - a[0], b[1] - a[1]
    px, py = x - a[0], y - a[1]
    along = np.clip((px * ex + py * ey) / (ex * ex + ey * ey), 0, 1)
    return np.asarray((px - along * ex) ** 2 + (py - along * ey) ** 2)


def _turned(count: int, points: list[Point]) -> list[Point]:
    """Points repeated clockwise about the origin."""
    angles = 2 * np.pi * np.arange(count) / count
    return [
        (float(x * np.cos(a) - y * np.sin(a)), float(x * np.sin(a) + y * np.cos(a)))
        for a in angles
        for x, y in points
    ]


def _cells(x: Array, count: int, pitch: float) -> list[Array]:
    """Coordinates relative to the two nearest cells of a row."""
    middle = (count - 1) / 2
    below = np.floor(x / pitch + middle)
    slots = [np.clip(below + step, 0, count - 1) for step in (0, 1)][: min(count, 2)]
    return [x - (slot - middle) * pitch for slot in slots]
