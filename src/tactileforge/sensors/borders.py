"""Light at the borders of pictures against that in the presses of a calibration."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from tactileforge.sensors.light import CELLS, edges_of

#: Border parts: cells along a side of the picture and of a part, largest edge of a cell that no
#: touch reaches, grey levels, and smallest share of such cells in a part that tells something.
_AROUND, _PART, _SMOOTH, _FREE = 32, 6, 3.0, 0.6
#: How far the changes lie beyond those of the calibration's presses in another light, grey levels,
#: and in how many parts (`docs/calibrate.md` has the alarms and lights that they come from).
_BEYOND = ((3.5, 1), (1.0, 5))
#: A light that comes and goes: seconds around a frame, the share of frames in another light in
#: them, and the least number of such frames (lone false alarms are fewer).
_NEAR, _SHARE, _LEAST = 0.25, 1 / 3, 3
#: Number of border parts, and names of their changes, a colour of a part each.
_EIGHT = 8
BORDER_FEATURES = tuple(
    f"border{part}_{color}" for part in range(_EIGHT) for color in ("red", "green", "blue")
)
#: Why a frame beyond the presses of a calibration gets no force.
OTHER_LIGHT = (
    "the borders of the picture changed as in none of the presses of the calibration, by another "
    "light or a touch in a new place"
)


def border_inputs(
    frames: NDArray[np.uint8], background: NDArray[np.uint8]
) -> dict[str, NDArray[np.float32]]:
    """Change of each colour in four corners and at four edges of pictures, float32 (N,) each.

    Mean signed change from the background, grey levels, over the cells without edges; 0 in parts
    that are mostly touched, and in pictures without enough pixels.

    Args:
        frames: uint8 (N, H, W, 3).
        background: uint8 (H, W, 3).

    Example:
        >>> rest = np.full((64, 48, 3), 100, np.uint8)
        >>> inputs = border_inputs(rest[None] + 8, rest)
        >>> len(inputs), float(inputs["border0_red"].max())
        (24, 8.0)
    """
    out = np.zeros((len(frames), len(BORDER_FEATURES)), np.float32)
    if min(background.shape[:2]) >= CELLS:  # else taxels, or too few pixels for an edge
        still = _around(background)
        for row, frame in zip(out, frames, strict=True):
            row[:] = _border_changes(_around(frame) - still)
    return dict(zip(BORDER_FEATURES, out.T, strict=True))


def _around(picture: NDArray[np.uint8]) -> NDArray[np.float32]:
    """Small picture, float32 (32, 32, 3), or of fewer rows or columns."""
    size = [min(_AROUND, length) for length in picture.shape[1::-1]]
    small = cv2.resize(np.ascontiguousarray(picture), size, interpolation=cv2.INTER_AREA)
    return np.asarray(small, np.float32)


def _border_changes(change: NDArray[np.float32]) -> NDArray[np.float32]:
    """Mean change of the untouched cells of each part, float32 (24,)."""
    free = edges_of(change) < _SMOOTH
    rows, columns = ((0, (n - _PART) // 2, n - _PART) for n in change.shape[:2])
    corners = [(row, column) for row in rows for column in columns]
    out = np.zeros((_EIGHT, 3), np.float32)
    for number, (row, column) in enumerate(corners[:4] + corners[5:]):  # without the middle
        part = slice(row, row + _PART), slice(column, column + _PART)
        if free[part].mean() > _FREE:
            out[number] = change[part][free[part]].mean(0)
    return out.ravel()


def border_range(inputs: Mapping[str, NDArray[np.floating]]) -> list[list[float]]:
    """Least and largest change of each border part over frames, grey levels, 24 each; 0 is within.

    Args:
        inputs: Changes by name, float (N,) each, see `border_inputs`; frames of NaN are left out.
    """
    changes = np.stack([inputs[name] for name in BORDER_FEATURES], -1)
    changes = changes[np.isfinite(changes).all(-1)]
    least, most = changes.min(0, initial=0), changes.max(0, initial=0)
    return [np.round(row.astype(np.float64), 2).tolist() for row in (least, most)]


def has_other_light(
    inputs: Mapping[str, NDArray[np.floating]], known: Sequence[Sequence[float]]
) -> NDArray[np.bool_]:
    """Whether border changes lie outside the range of the presses of a calibration.

    A touch makes a colour brighter in one part and darker in another. Light is brighter, or
    darker, in all that it reaches.

    Args:
        inputs: Changes by name, float (...) each, see `border_inputs`.
        known: Range of the presses, see `border_range`; empty for none.

    Returns:
        bool (...).
    """
    changes = np.stack([np.asarray(inputs[name]) for name in BORDER_FEATURES], -1)
    if not known:
        return np.zeros(changes.shape[:-1], bool)
    least, most = np.reshape(known, (2, _EIGHT, 3))
    changes = changes.reshape(*changes.shape[:-1], _EIGHT, 3)
    found = np.zeros(changes.shape[:-2], bool)
    for far, parts in _BEYOND:
        up, down = changes > most + far, changes < least - far
        is_one_sided = ~(up.any(-2) & down.any(-2)).any(-1)
        found |= is_one_sided & ((up | down).any(-1).sum(-1) >= parts)
    return found


def amid_other_light(
    lit: NDArray[np.bool_], times: NDArray[np.float64], ahead: bool = True
) -> NDArray[np.bool_]:
    """Frames in another light, and those among many such frames, as of a flickering lamp.

    Near its zero a flicker is too weak to be seen in a picture, and still worth a newton.

    Args:
        lit: Whether a frame is in another light, (T,).
        times: Times of the frames, s, (T,), rising.
        ahead: Whether later frames count, too.

    Returns:
        bool (T,).

    Example:
        >>> lit = np.array([True, False, True, True, False, False])
        >>> amid_other_light(lit, np.arange(6) / 30).tolist()
        [True, True, True, True, True, True]
        >>> amid_other_light(lit, np.arange(6) * 1.0).tolist()
        [True, False, True, True, False, False]
    """
    count = np.concatenate([[0], np.cumsum(lit)])
    first = np.searchsorted(times, times - _NEAR, "left")
    last = np.searchsorted(times, times + _NEAR, "right") if ahead else np.arange(len(lit)) + 1
    found = count[last] - count[first]
    among: NDArray[np.bool_] = (found >= _LEAST) & (found >= _SHARE * (last - first))
    return lit | among
