"""Height fields of textures: ridges, threads, weaves, pebbles, grains, tiles.

A relief is the depth in mm below the outermost plane, 0 or more, as a function of ``x`` and ``y``
in mm. The random ones are drawn from a seed, and are the same at any resolution.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from tactileforge_sim.geometry.indenter_geometry import DEEP, Height, extrude, rod
from tactileforge_sim.geometry.sdf2d import SDF, Array, box, ellipse, minus

#: Column, row of a crossing -> whether the upright yarn is on top.
Pattern: TypeAlias = Callable[[Array, Array], NDArray[Any]]

#: Number of waves of a rough surface.
_WAVES = 32


def waves(period: float, depth: float, angle: float = 0.0) -> Height:
    """Rounded ridges, one after the other along the direction ``angle``, degrees."""
    cosine, sine = np.cos(np.radians(angle)), np.sin(np.radians(angle))
    return lambda x, y: depth / 2 * (1 - np.cos(2 * np.pi * (x * cosine + y * sine) / period))


def grooves(period: float, depth: float, angle: float = 0.0) -> Height:
    """Sharp ridges with flat flanks, one after the other along ``angle``, degrees."""
    cosine, sine = np.cos(np.radians(angle)), np.sin(np.radians(angle))
    return lambda x, y: depth * _sharp((x * cosine + y * sine) / period)


def thread(diameter: float, pitch: float) -> Height:
    """A metric screw thread on a lying rod: flanks at 60 degrees, flat crests (ISO 68-1)."""
    radius, full = diameter / 2, pitch * np.sqrt(3) / 2

    def relief(x: Array, y: Array) -> Array:
        around_axis = np.arcsin(np.clip(y / radius, -1, 1)) / (2 * np.pi)
        flank = full * _sharp(x / pitch + around_axis) - full / 8
        return np.asarray(np.clip(flank, 0, full * 17 / 24))

    return rod(radius, relief)


def coil(radius: float, pitch: float, wire: float) -> Height:
    """A lying spring, from the thickness of its wire."""

    def relief(x: Array, y: Array) -> Array:
        around_axis = np.arcsin(np.clip(y / radius, -1, 1)) / (2 * np.pi)
        turns = x / pitch + around_axis
        across = (turns - np.round(turns)) * pitch
        return extrude(lambda u, v: np.abs(u) - wire / 2, wire / 2)(across, across)

    return rod(radius, relief)


def knit(width: float, height: float, depth: float) -> Height:
    """Knitted cloth: columns of loops, each a pair of slanted legs."""
    leg = ellipse(0.23 * width, 0.62 * height)

    def relief(x: Array, y: Array) -> Array:
        side = x / width - np.floor(x / width) - 0.5
        lean = y / height - 0.9 * np.abs(side)
        u, v = (np.abs(side) - 0.25) * width, (lean - np.round(lean)) * height
        return depth * np.clip(1 + leg(u, v) / (0.23 * width), 0, 1) ** 2

    return relief


def gauze(pitch: float, wire: float) -> Height:
    """Crossed round wires with open space between them."""
    bare = extrude(lambda u, v: np.abs(u) - wire / 2, wire / 2)

    def relief(x: Array, y: Array) -> Array:
        u, v = x / pitch, y / pitch
        column, row = np.round(u), np.round(v)
        sign = np.cos(np.pi * row), np.cos(np.pi * column)
        upright = wire / 2 * (1 - sign[1] * np.cos(np.pi * v))
        lying = wire / 2 * (1 + sign[0] * np.cos(np.pi * u))
        return np.minimum(
            bare((u - column) * pitch, y) + upright, bare((v - row) * pitch, x) + lying
        )

    return relief


def deeper(*reliefs: Height) -> Height:
    """Reliefs cut into each other."""
    return lambda x, y: np.max([relief(x, y) for relief in reliefs], axis=0)


def raised(mask: SDF, depth: float, fillet: float = 0.15) -> Height:
    """A raised outline on a ground ``depth`` mm below."""
    height = extrude(mask, fillet)
    return lambda x, y: np.minimum(height(x, y), depth)


def cut(mask: SDF, depth: float, fillet: float = 0.15) -> Height:
    """An outline cut ``depth`` mm deep into the ground."""
    return raised(minus(lambda x, y: np.full(x.shape, -np.inf), mask), depth, fillet)


def weave(pitch: float, depth: float, over: Pattern) -> Height:
    """Cloth: two interlaced sets of yarns.

    Args:
        pitch: Distance of two yarns, mm.
        depth: Depth of a yarn at its lowest below its highest point, mm.
        over: Column, row -> 1 where the upright yarn is on top, else 0.
    """

    def relief(x: Array, y: Array) -> Array:
        u, v = x / pitch, y / pitch
        upright = _yarn(u, v, over)
        lying = _yarn(v, u, lambda j, i: 1 - over(i, j))
        return depth * np.minimum(upright, lying)

    return relief


def cells(size: float, seed: int) -> Callable[[Array, Array], tuple[Array, Array, Array]]:
    """Scattered points: distances to the nearest and the next one, and a number of the nearest."""
    side = 16
    # Points repeat after 16 cells: any place has some, from a table of constant size.
    table = np.random.default_rng(seed).random((3, side, side))

    def nearest(x: Array, y: Array) -> tuple[Array, Array, Array]:
        column, row = np.floor(x / size).astype(int), np.floor(y / size).astype(int)
        first, second = np.full(x.shape, np.inf), np.full(x.shape, np.inf)
        number = np.zeros(x.shape)
        for i in (-1, 0, 1):
            for j in (-1, 0, 1):
                px, py, value = table[:, (row + j) % side, (column + i) % side]
                away = np.hypot((column + i + px) * size - x, (row + j + py) * size - y)
                number = np.where(away < first, value, number)
                second = np.minimum(second, np.maximum(first, away))
                first = np.minimum(first, away)
        return first, second, number

    return nearest


def leather(size: float, depth: float, seed: int) -> Height:
    """Rounded pebbles with creases between them."""
    scattered = cells(size, seed)

    def relief(x: Array, y: Array) -> Array:
        first, second, _ = scattered(x, y)
        return depth * np.exp(-(((second - first) / (0.25 * size)) ** 2))

    return relief


def grit(size: float, depth: float, seed: int) -> Height:
    """Grains of random heights."""
    scattered = cells(size, seed)

    def relief(x: Array, y: Array) -> Array:
        first, _, number = scattered(x, y)
        return depth * np.clip(0.5 * number + (first / size) ** 2, 0, 1)

    return relief


def bumps(length: float, depth: float, seed: int) -> Height:
    """Smooth random hills about ``length`` mm apart."""
    draw = np.random.default_rng(seed)
    angle, often, phase = draw.uniform(0, np.pi, 24), draw.uniform(0.7, 1.4, 24), draw.random(24)
    turns = 2 * np.pi * np.stack([np.cos(angle) * often, np.sin(angle) * often]) / length
    total = _cosines(np.ones(24), turns[0], turns[1], 2 * np.pi * phase)
    return lambda x, y: np.asarray(depth * np.clip(0.5 + 0.5 * total(x, y) / 6, 0, 1))


def rough(deviation: float, seed: int) -> Height:
    """A self-affine random surface, of waves of 0.5 to 4 mm and Hurst exponent 0.8.

    Waves grow with their length, as on machined, printed and worn surfaces (B. N. J. Persson and
    others, "On the nature of surface roughness", J. Phys.: Condens. Matter 17, 2005).

    Args:
        deviation: Standard deviation of the heights, mm.
        seed: Seed of the waves.
    """
    draw = np.random.default_rng(seed)
    angle, phase = draw.uniform(0, np.pi, _WAVES), draw.uniform(0, 2 * np.pi, _WAVES)
    length = 0.5 * 8 ** draw.random(_WAVES)
    size = length**0.8
    size *= deviation * np.sqrt(2 / np.square(size).sum())
    turns = 2 * np.pi * np.stack([np.cos(angle), np.sin(angle)]) / length
    total = _cosines(size, turns[0], turns[1], phase)
    return lambda x, y: np.asarray(np.maximum(total(x, y) + 3 * deviation, 0))


def covered(height: Height, relief: Height, finer: float = 1.0) -> Height:
    """A height with a relief on it, its waves ``finer`` times as short."""
    return lambda x, y: np.minimum(height(x, y) + relief(finer * x, finer * y), DEEP)


def worn(height: Height, radius: float) -> Height:
    """A height with edges worn over a radius, mm: the mean of five places.

    No place loses more than the radius: else the middle of a thin part would be hollow.
    """
    steps = radius * np.array([(0, 0), (1, 0), (0, 1), (-1, 0), (0, -1)])

    def rounded(x: Array, y: Array) -> Array:
        near = [height(x + a, y + b) for a, b in steps]
        return np.minimum(np.mean(near, axis=0), near[0] + radius)

    return rounded


def warped(height: Height, deviation: float, seed: int) -> Height:
    """A height with its places displaced by waves of 2 to 16 mm along x and y.

    Args:
        height: Any height.
        deviation: Standard deviation of the displacement along each axis, mm.
        seed: Seed of the waves.
    """
    right, down = (rough(deviation, seed + axis) for axis in (0, 1))
    middle = 3 * deviation

    def moved(x: Array, y: Array) -> Array:
        u, v = x / 4, y / 4
        return height(x + right(u, v) - middle, y + down(u, v) - middle)

    return moved


def grain(period: float, depth: float, seed: int) -> Height:
    """Wood: bent lines along ``x``."""
    bend = bumps(9, 2.2 * period, seed)
    return lambda x, y: depth * np.abs(np.sin(np.pi * (y + bend(x * 0.5, y)) / period)) ** 3


def whorl(period: float, depth: float, bend: float = 1.0) -> Height:
    """Concentric ridges, bent by up to ``bend`` mm as on a fingertip."""
    shift, ridges = bumps(5, bend, 7), waves(period, depth)
    return lambda x, y: ridges(np.hypot(x, y) + shift(x, y), y)


def hexagons(pitch: float) -> SDF:
    """Hexagons side by side, as the distance to the nearest border; negative inside all of them."""
    px, py = pitch, pitch * np.sqrt(3)

    def distance(x: Array, y: Array) -> Array:
        return np.minimum(_cell(x, y), _cell(x - px / 2, y - py / 2))

    def _cell(x: Array, y: Array) -> Array:
        u, v = np.abs(x - px * np.round(x / px)), np.abs(y - py * np.round(y / py))
        return np.asarray(np.maximum(u, u / 2 + v * np.sqrt(3) / 2) - pitch / 2)

    return distance


def bricks(width: float, height: float, joint: float) -> SDF:
    """A wall of bricks, shifted by half a brick from row to row."""
    brick = box(width - joint, height - joint)

    def distance(x: Array, y: Array) -> Array:
        row = np.round(y / height)
        u = x / width + row / 2
        return brick((u - np.round(u)) * width, y - row * height)

    return distance


def _cosines(high: Array, across: Array, down: Array, start: Array) -> Height:
    """A sum of waves, each with a height, wave numbers along x and y (rad/mm), and a phase."""

    def total(x: Array, y: Array) -> Array:
        if x.ndim == 2 and (x == x[:1]).all() and (y == y[:, :1]).all():
            # On a grid cos(a + b) is cos a cos b - sin a sin b: two products of matrices.
            along, upright = np.outer(down, y[:, 0]), np.outer(across, x[0]) + start[:, None]
            cosine = (high[:, None] * np.cos(along)).T @ np.cos(upright)
            sine = (high[:, None] * np.sin(along)).T @ np.sin(upright)
            return np.asarray(cosine - sine)
        parts = zip(high, across, down, start, strict=True)
        return np.asarray(sum(h * np.cos(fx * x + fy * y + s) for h, fx, fy, s in parts))

    return total


def _sharp(phase: Array) -> Array:
    """A triangle wave: 0 at whole phases, 1 between them."""
    return np.asarray(2 * np.abs(phase - np.round(phase)))


def _yarn(across: Array, along: Array, over: Pattern) -> Array:
    """Depth of a set of yarns: 0 on top, 1 below; ``over`` takes yarn and crossing."""
    number = np.floor(across)
    crown = 1 - np.sqrt(1 - 0.95 * (2 * (across - number) - 1) ** 2)
    crossing = np.floor(along - 0.5)
    part = np.clip(1.8 * (along - 1 - crossing) + 0.5, 0, 1)
    part = part * part * (3 - 2 * part)
    top = (1 - part) * over(number, crossing) + part * over(number, crossing + 1)
    return np.asarray(1 - top + crown)
