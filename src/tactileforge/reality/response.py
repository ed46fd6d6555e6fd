"""How the picture answers to normal force and to shear, by regression over the frames of a trial.

The imprint moves when the object slides, and the picture with it, so each change picture is first
moved back onto the reference by the displacement of its imprint. What is left is fitted pixel by
pixel as ``a + b z + c z^2 + d x + e y`` of the forces x, y and z. The fit is made on two halves of the
trial, and the response is the part that both agree on: noise, which differs, drops out of the product
of their coefficients.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from tactileforge.contracts import Recording
from tactileforge.inspection.look import evenly
from tactileforge.reality import measures
from tactileforge.reality.measures import Array

#: Frames of a trial that are fitted, the share of the largest force from which on they are, and the
#: frames of a block that goes to one half.
_FRAMES, _PRESSED, _BLOCK = 240, 0.25, 8
#: Fewest frames in contact, and smallest deviation of a shear force (N), of which a fit tells.
_LEAST, _SHEARED = 24, 0.1
#: Places on the curve of change against normal force, shares of the largest force.
SHARES = (0.25, 0.5, 0.75)


@dataclass(frozen=True)
class Response:
    """What a newton does to the picture of one trial.

    Attributes:
        normal: Root mean square over the contact of the change by normal force at its mean, grey
            levels per N.
        shear: The same by shear along x and along y, at constant normal force; NaN along an axis
            that the trial does not shear.
        relative: Mean change by 1 N of shear over the mean change in the contact.
        curve: Mean change of the picture at `SHARES` of the largest normal force, over that at the
            largest.
    """

    normal: float
    shear: tuple[float, float]
    relative: float
    curve: tuple[float, ...]


def response(recording: Recording) -> Response | None:
    """Fits a trial; None where it has no force, no background, or too few frames in contact.

    Raises:
        DataError: A frame cannot be decoded.
    """
    if recording.force is None or recording.no_contact is None:
        return None
    known = np.flatnonzero(np.isfinite(recording.force).all(axis=1))
    known = known[evenly(len(known), _FRAMES)] if len(known) else known
    force = recording.force[known].astype(np.float64)
    if len(known) < _LEAST or force[:, 2].max() <= 0:
        return None
    still = recording.no_contact.read(range(min(len(recording.no_contact), 15)))
    background = measures.sized(np.median(still, axis=0))
    frames = recording.frames.read(known.tolist())
    changes = np.stack([_half(measures.sized(frame) - background) for frame in frames])
    return fitted(changes, force)


def _half(change: Array) -> Array:
    """A quarter of the pixels: the response is smooth, and trials are long."""
    return cv2.resize(change, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)


def fitted(changes: Array, force: Array) -> Response | None:
    """The response of change pictures to forces.

    Args:
        changes: float32 (T, H, W, 3), grey levels, in order of time.
        force: float64 (T, 3), N.
    """
    pressed = np.flatnonzero(force[:, 2] > _PRESSED * force[:, 2].max())
    if len(pressed) < _LEAST:
        return None
    curve = _curve(np.abs(changes).mean(axis=(1, 2, 3)), force[:, 2])
    moved, touched = _aligned(changes[pressed])
    if not touched.any():
        return None
    pixels = moved[:, touched].reshape(len(pressed), -1)
    axes = [i for i in (0, 1) if force[pressed, i].std() >= _SHEARED]
    slopes = _slopes(pixels, force[pressed], axes)
    shear = [slopes[1 + axes.index(i)] if i in axes else np.nan for i in (0, 1)]
    size = np.sqrt(np.square(pixels.mean(axis=0)).mean())
    known = [one for one in shear if np.isfinite(one)]
    relative = float(np.mean(known) / size) if known else np.nan
    return Response(slopes[0], (shear[0], shear[1]), relative, curve)


def _curve(size: Array, normal: Array) -> tuple[float, ...]:
    """Median change near shares of the largest force, over that near the largest."""
    share = normal / normal.max()
    near = [np.abs(share - at) < 0.1 for at in (*SHARES, 1.0)]
    found = [float(np.median(size[rows])) if rows.any() else np.nan for rows in near]
    return tuple(one / found[-1] for one in found[:-1])


def _aligned(changes: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Changes moved onto the strongest of them, and the contact there.

    Returns:
        float32 (T, H, W, 3) and bool (H, W).
    """
    sizes = np.stack([measures.smooth(change) for change in changes])
    strongest = int(sizes.mean(axis=(1, 2)).argmax())
    reference = sizes[strongest]
    height, width = reference.shape
    window = cv2.createHanningWindow((width, height), cv2.CV_32F)
    out = np.empty_like(changes)
    for row, change in enumerate(changes):
        (x, y), _ = cv2.phaseCorrelate(reference, sizes[row], window)
        step = np.array([[1, 0, -x], [0, 1, -y]])
        out[row] = cv2.warpAffine(change, step, (width, height), borderMode=cv2.BORDER_REPLICATE)
    return out, measures.contact(changes[strongest])


def _slopes(pixels: Array, force: Array, axes: Sequence[int]) -> list[float]:
    """Size of the change per newton of normal force, and of shear along each of the axes.

    Args:
        pixels: (T, P), grey levels.
        force: (T, 3), N.
        axes: Of the shear that is fitted.
    """
    normal = force[:, 2] - force[:, 2].mean()
    columns = [np.ones_like(normal), normal, normal**2, *(force[:, i] for i in axes)]
    by = np.stack(columns, axis=1)
    half = (np.arange(len(by)) // _BLOCK) % 2 == 0
    one, other = (np.linalg.lstsq(by[rows], pixels[rows], rcond=None)[0] for rows in (half, ~half))
    common = (one * other).mean(axis=1)
    return np.sqrt(np.maximum(common, 0))[[1, *range(3, by.shape[1])]].tolist()
