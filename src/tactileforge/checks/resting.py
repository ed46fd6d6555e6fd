"""Comparison of the resting pictures of a sensor: colours, and orientation."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactileforge.errors import ConfigError
from tactileforge.sensors.resting_colours import (
    COLOURED,
    MIRRORED_BY,
    TURNED,
    colour_agreement,
    colour_grid,
    has_colours,
    has_other_order,
    is_grey,
    is_swapped,
    known_colours,
    mirror_leads,
    mirror_of,
    turn_of,
)
from tactileforge.specs.published import spec

#: Largest number of recordings to compare a set with, and of keys named in a line.
_COMPARED, _NAMED = 64, 8
#: Smallest agreement with the sensor of a picture that is upright, or upside down, and how much
#: better it is than the other way round; public sets reach .91 and .3.
_SURE, _SURER = 0.85, 0.2
#: How much better one way round is that is sure with dirt or other lights: the other contradicts.
_CONTRADICTS = 1.0
#: Ratio of sides above which a picture shows several panels: no sensor is that wide.
_PANELS = 2.0
#: Largest relative difference of the ratio of sides from that of the turned sensor.
_SIDES = 0.1


@dataclass(frozen=True)
class Resting:
    """Resting picture of a recording.

    Attributes:
        key: Key of the recording.
        sensor: Sensor of the recording.
        shape: Height and width of a frame, pixels.
        still: float32 (h, w, 3), the small picture without contact.
    """

    key: str
    sensor: str
    shape: tuple[int, int]
    still: NDArray[np.float32]

    @cached_property
    def grid(self) -> NDArray[np.float64]:
        """`colour_grid` of the picture."""
        return colour_grid(self.still)


@dataclass(frozen=True)
class OddGroup:
    """Recordings of a sensor with odd resting pictures.

    Attributes:
        reason: Reason, one of `checks.REASONS`.
        rows: Numbers of the recordings.
        words: Appearance of each.
        line: Line on all of them, for messages.
        keys: Keys of a layout that put them right, with their values.
    """

    reason: str
    rows: tuple[int, ...]
    words: str
    line: str
    keys: Mapping[str, Any] = field(default_factory=dict)


def odd_pictures(seen: Sequence[Resting], has_layout: bool = True) -> Iterator[OddGroup]:
    """Yield groups of odd resting pictures, sensor by sensor.

    Args:
        seen: Resting pictures of the decoded recordings.
        has_layout: Whether a layout describes the data, with keys that put pictures right.
    """
    for sensor in sorted({one.sensor for one in seen}):
        # sensor by sensor: their lights differ, so only pictures of one type can be compared
        rows = [i for i, one in enumerate(seen) if one.sensor == sensor]
        grey = [i for i in rows if is_grey(seen[i].still)]
        if grey and (sensor in COLOURED or 2 * len(grey) < len(rows)):
            words = "grey, where the sensor is lit in colours"
            yield _odd("grey_pictures", grey, rows, seen, f"are {words}", words)
        coloured = [i for i in rows if has_colours(seen[i].grid)]
        mirrors = _mirrored(coloured, sensor, seen)
        for axis in ("x", "y"):
            if odd := [i for i in rows if mirrors.get(i) == axis]:
                sides = "left and right" if axis == "x" else "top and bottom"
                fix = _fix(f"mirror: {axis}", "puts them right", has_layout)
                words = f"mirrored, {sides} exchanged ({fix})"
                yield _odd("mirrored", odd, rows, seen, f"look {words}", words, {"mirror": axis})
        coloured = [i for i in coloured if i not in mirrors]
        upright = [i for i in rows if i not in mirrors]
        yield from _turned(upright, coloured, sensor, seen, has_layout)


def _turned(
    rows: list[int], coloured: list[int], sensor: str, seen: Sequence[Resting], has_layout: bool
) -> Iterator[OddGroup]:
    """Turned pictures, and those with other channels, among recordings that are not mirrored."""
    found = {i: _turn(seen[i], sensor) for i in coloured}
    reference = known_colours(sensor)
    if reference is not None:
        standing = [i for i in rows if found.get(i) in (0, 180)]
        yield from _upside_down(rows, standing, reference, seen)
    turns: dict[int, int | None] = {i: turn for i, turn in found.items() if turn in (90, 270)}
    turns |= dict.fromkeys(_on_their_side([i for i in rows if i not in turns], seen), None)
    for turn in sorted(set(turns.values()), key=str):
        odd = [i for i in rows if i in turns and turns[i] == turn]
        fix = _fix(f"rotate: {turn or '90 or 270'}", "puts it upright", has_layout)
        words = f"lying on its side ({fix})"
        keys: dict[str, Any] = {"rotate": turn} if turn else {}
        yield _odd("on_its_side", odd, rows, seen, f"look as if {words}", words, keys)
    other: list[int] = []
    if reference is not None:
        other = [i for i in coloured if has_other_order(seen[i].grid, reference)]
    if other:
        words = "as if their channels were neither RGB nor BGR (write them as RGB)"
        yield _odd("colours_swapped", other, rows, seen, f"look {words}", words)
    if reference is not None:
        swapped = [i for i in coloured if i not in other and _is_swapped(seen[i], reference)]
    else:  # not those on their side, whose lights are elsewhere
        swapped = _swapped_here([i for i in coloured if i not in turns], seen)
    if swapped:
        fix = _fix("channels: bgr", "puts them right", has_layout)
        words = f"as if red and blue were swapped ({fix})"
        keys = {"channels": "bgr"}
        yield _odd("colours_swapped", swapped, rows, seen, f"look {words}", words, keys)


def _mirrored(rows: list[int], sensor: str, seen: Sequence[Resting]) -> dict[int, str]:
    """Axis of the mirror of each mirrored picture, by the sensor or by most other recordings."""
    reference = known_colours(sensor)
    if reference is not None:
        found = {}
        # channels in yet another order may look like a mirror
        rows = [i for i in rows if not has_other_order(seen[i].grid, reference)]
        for i in rows:
            # with red and blue swapped as well, as one recorder may get both wrong
            as_is, swapped = seen[i].grid, seen[i].grid[..., ::-1]
            if axis := mirror_of(as_is, reference) or mirror_of(swapped, reference):
                found[i] = axis
        return found | _like_the_others(rows, found, seen, reference)
    for i in rows[:_COMPARED]:
        axes = {j: mirror_of(seen[j].grid, seen[i].grid) for j in rows}
        odd = {j: axis for j, axis in axes.items() if axis}
        same = [j for j in rows if colour_agreement(seen[i].grid, seen[j].grid) >= TURNED]
        if odd and len(odd) < len(same) and 2 * (len(odd) + len(same)) > len(rows):
            return odd
    return {}


def _like_the_others(
    rows: list[int],
    found: Mapping[int, str],
    seen: Sequence[Resting],
    reference: NDArray[np.float64],
) -> dict[int, str]:
    """Unclear pictures of a set of which all clear ones are mirrored along one axis.

    The lights of some units are nearly the same in a mirror; a whole set was recorded alike.
    """
    axes = set(found.values())
    if len(axes) != 1:
        return {}
    axis = next(iter(axes))
    leads = {i: mirror_leads(seen[i].grid, reference) for i in rows if i not in found}
    if any(max(lead.values()) <= -MIRRORED_BY for lead in leads.values()):
        return {}  # some stand as they should
    return {i: axis for i, lead in leads.items() if lead[axis] > -MIRRORED_BY}


def _fix(key: str, effect: str, has_layout: bool) -> str:
    if has_layout:
        return f"{key} in the layout {effect}"
    return f"{key} in the map or options of the data set {effect}; without such a key, in the files"


def _odd(
    reason: str,
    odd: list[int],
    of: list[int],
    seen: Sequence[Resting],
    what: str,
    words: str,
    keys: Mapping[str, Any] | None = None,
) -> OddGroup:
    names = [seen[i].key for i in odd]
    more = f" and {len(names) - _NAMED} more" if len(names) > _NAMED else ""
    listed = f"{', '.join(names[:_NAMED])}{more}"
    line = f"{seen[odd[0]].sensor}: {len(odd)} of {len(of)} {what}: {listed}"
    return OddGroup(reason, tuple(odd), words, line, keys or {})


def _upside_down(
    rows: list[int], standing: list[int], known: NDArray[np.float64], seen: Sequence[Resting]
) -> Iterator[OddGroup]:
    """The minority among upright recordings and those after half a turn.

    A whole set may be mounted either way; its axes of force then are those of its pictures.
    """
    sides: tuple[list[int], list[int]] = [], []
    for i in standing:
        grid = seen[i].grid
        fits = colour_agreement(grid, known), colour_agreement(grid[::-1, ::-1], known)
        lead = abs(fits[0] - fits[1])
        if (max(fits) >= _SURE and lead >= _SURER) or lead >= _CONTRADICTS:
            sides[fits[1] > fits[0]].append(i)
    if all(sides):
        words = "upside down beside the others (rotate: 180 in the layout turns them)"
        keys = {"rotate": 180}
        yield _odd("on_its_side", min(sides, key=len), rows, seen, f"are {words}", words, keys)


def _turn(one: Resting, sensor: str) -> int | None:
    """Degrees to put a picture upright, clockwise; None if unsure."""
    reference = known_colours(sensor)
    if reference is None or max(one.shape) > _PANELS * min(one.shape):
        return None
    # with red and blue swapped as well, as one recorder may get both wrong
    for grid in (one.grid, one.grid[..., ::-1]):
        if (turn := turn_of(grid, reference)) is not None:
            return turn
    return None


def _on_their_side(rows: list[int], seen: Sequence[Resting]) -> list[int]:
    """Recordings with exchanged sides, compared with the sensor or with most other recordings."""
    shapes = [seen[i].shape for i in rows]
    common = max(set(shapes), key=lambda shape: (shapes.count(shape), shape)) if shapes else (1, 1)
    odd = []
    for i in rows:
        one = seen[i]
        height, width = one.shape
        is_minor = (width, height) == common != one.shape
        is_rare = 2 * shapes.count(one.shape) < shapes.count(common)
        if (is_minor and is_rare) or (has_colours(one.grid) and _is_transposed(one)):
            odd.append(i)
    return odd


def _is_transposed(one: Resting) -> bool:
    """Whether a picture of a known sensor has its sides exchanged, and does not look upright."""
    try:
        known = spec(one.sensor)
    except ConfigError:  # the sensor is not installed here
        return False
    if not known.height or known.height == known.width:
        return False
    reference = known_colours(one.sensor)
    if reference is None:  # another camera may give it portrait
        return False
    ratio = one.shape[0] / one.shape[1] * known.height / known.width
    return abs(ratio - 1) < _SIDES and turn_of(one.grid, reference) != 0


def _is_swapped(one: Resting, reference: NDArray[np.float64]) -> bool:
    """Whether red and blue are swapped, by the known colours of the sensor, in any orientation."""
    turns = [np.rot90(one.grid, -quarter) for quarter in range(4)]
    as_is = max(colour_agreement(grid, reference) for grid in turns)
    best = max(turns, key=lambda grid: colour_agreement(grid[..., ::-1], reference))
    return is_swapped(best, reference) and colour_agreement(best[..., ::-1], reference) > as_is


def _swapped_here(rows: list[int], seen: Sequence[Resting]) -> list[int]:
    """Recordings with swapped red and blue in comparison with the others: the minority."""
    sides = [
        ([j for j in rows if is_swapped(seen[j].grid, seen[i].grid)], i) for i in rows[:_COMPARED]
    ]
    for swapped, i in sides:
        same = [
            j
            for j in rows
            if j not in swapped and colour_agreement(seen[i].grid, seen[j].grid) >= 0.5
        ]
        if swapped and 2 * (len(swapped) + len(same)) > len(rows):
            return swapped if len(swapped) <= len(same) else same
    return []
