"""Response of the image to normal force and shear, by regression over the frames of a trial.

When the object slides, its imprint moves in the image. Each change image is first moved back
onto the strongest one, by the translation of largest enhanced correlation (Evangelidis and
Psarakis, 2008). The result is fitted pixel by pixel as ``a + b z + c z^2 + d x + e y`` of the
forces x, y and z, plus a quadratic of the imprint's place, because light varies over the image.
Trials slide forth and back: each place is seen with shear of both signs. The fit is made on two
halves of the trial, and the response is their common part: their noise is independent, and drops
out of the product of their coefficients. A change indistinguishable from a motion of the imprint
does not count.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from reality import measures
from reality.measures import Array
from tactileforge.checks.sample import evenly
from tactileforge.contracts import Recording

#: Largest number of fitted frames of a trial; their least force, as a share of the largest; and
#: length of the blocks assigned to the two halves in turn, frames.
_FRAMES, _PRESSED, _BLOCK = 240, 0.25, 8
#: Requirements of a fit: frames in contact, and standard deviation of a shear force, N.
_LEAST, _SHEARED = 120, 0.3
#: Largest difference of an estimated translation from that of the change's centre, pixels.
_ASTRAY = 15.0
#: Places on the curve of change against normal force, shares of the largest force.
SHARES = (0.25, 0.5, 0.75)


@dataclass(frozen=True)
class Response:
    """Change of the image per newton in one trial.

    Attributes:
        normal: Root mean square over the contact of the change by normal force at its mean, grey
            levels per N.
        shear: The same by shear along x and along y, at constant normal force; NaN for an axis
            without shear in the trial.
        relative: Mean change by 1 N of shear over the mean change in the contact.
        curve: Mean change of the image at `SHARES` of the largest normal force, over that at the
            largest.
    """

    normal: float
    shear: tuple[float, float]
    relative: float
    curve: tuple[float, ...]


def response(recording: Recording) -> Response | None:
    """Fits a trial; None without force, without background, or with too few frames in contact.

    Raises:
        DataError: A frame cannot be decoded.
    """
    read = _read(recording)
    return None if read is None or len(read[0]) < _LEAST else fitted(*read)


def whole_shear(recording: Recording) -> tuple[float, float] | None:
    """`shear_everywhere` of a trial; None without force or without background.

    Raises:
        DataError: A frame cannot be decoded.
    """
    read = _read(recording)
    return None if read is None else shear_everywhere(*read)


def _read(recording: Recording) -> tuple[Array, Array] | None:
    """Changes of a trial's frames at half size, and their forces; None for no force."""
    if recording.force is None or recording.no_contact is None:
        return None
    known = np.flatnonzero(np.isfinite(recording.force).all(axis=1))
    known = known[evenly(len(known), _FRAMES)] if len(known) else known
    force = recording.force[known].astype(np.float64)
    if not len(known) or force[:, 2].max() <= 0:
        return None
    still = recording.no_contact.read(range(min(len(recording.no_contact), 15)))
    background = measures.sized(np.median(still, axis=0))
    frames = recording.frames.read(known.tolist())
    changes = np.stack([_half(measures.sized(frame) - background) for frame in frames])
    return changes, force


def _half(change: Array) -> Array:
    """The change at half the width and height: the response is smooth, and trials are long."""
    height, width = change.shape[:2]
    out: Array = cv2.resize(change, (width // 2, height // 2), interpolation=cv2.INTER_AREA)
    return out


def fitted(changes: Array, force: Array) -> Response | None:
    """The response of change images to forces.

    Args:
        changes: float32 (T, H, W, 3), grey levels, in order of time.
        force: float64 (T, 3), N.
    """
    pressed = np.flatnonzero(force[:, 2] > _PRESSED * force[:, 2].max())
    if len(pressed) < _LEAST or not measures.contact(changes[_strongest(changes)]).any():
        return None
    curve = _curve(np.abs(changes).mean(axis=(1, 2, 3)), force[:, 2])
    moved, places, touched = _aligned(changes[pressed])
    kept = np.isfinite(places[:, 0])
    if np.count_nonzero(kept) < _LEAST:
        return None
    pixels, forces = moved[kept][:, touched], force[pressed][kept]
    pixels = pixels.reshape(len(pixels), -1)
    axes = [i for i in (0, 1) if forces[:, i].std() >= _SHEARED]
    slopes = _slopes(pixels, forces, places[kept], axes)
    shear = [slopes[1 + axes.index(i)] if i in axes else np.nan for i in (0, 1)]
    size = np.sqrt(np.square(pixels.mean(axis=0)).mean())
    relative = float(np.mean(slopes[1:]) / size) if axes else np.nan
    return Response(slopes[0], (shear[0], shear[1]), relative, curve)


def shear_everywhere(changes: Array, force: Array) -> tuple[float, float]:
    """Change of the whole picture by 1 N of shear along x and y, mean size in grey levels.

    The fit ``a + b z + c z^2 + d x + e y`` of pictures as they are: motion of the imprint with the
    shear counts.

    Args:
        changes: float32 (T, H, W, 3), grey levels.
        force: float64 (T, 3), N.
    """
    pressed = force[:, 2] > _PRESSED * force[:, 2].max()
    x, y, z = force[pressed].T
    normal = z - z.mean()
    by = np.stack([np.ones_like(x), normal, normal**2, x, y], axis=1)
    pixels = changes[pressed].reshape(len(by), -1)
    along, across = np.abs(np.linalg.lstsq(by, pixels, rcond=None)[0][3:]).mean(axis=1)
    return float(along), float(across)


def _curve(size: Array, normal: Array) -> tuple[float, ...]:
    """Median change near `SHARES` of the largest force, relative to the change near the largest."""
    share = normal / normal.max()
    near = [np.abs(share - at) < 0.1 for at in (*SHARES, 1.0)]
    medians = [float(np.median(size[rows])) if rows.any() else np.nan for rows in near]
    return tuple(median / medians[-1] if medians[-1] else np.nan for median in medians[:-1])


def _aligned(changes: Array) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Changes moved onto the strongest of them.

    Returns:
        Moved changes, float32 (T, H, W, 3); places of their imprints (T, 2), pixels from the
        strongest, NaN if not found; and the contact of the strongest, bool (H, W).
    """
    strongest = _strongest(changes)
    sizes = [measures.smooth(change) for change in changes]
    height, width = changes.shape[1:3]
    out, places = np.empty_like(changes), np.full((len(changes), 2), np.nan)
    for row, change in enumerate(changes):
        step = _translation(sizes[strongest], sizes[row])
        if step is not None:
            places[row] = step[:, 2]
            how = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
            out[row] = cv2.warpAffine(
                change, step, (width, height), flags=how, borderMode=cv2.BORDER_REPLICATE
            )
    return out, places, measures.contact(changes[strongest])


def _strongest(changes: Array) -> int:
    return int(np.argmax([np.abs(change).mean() for change in changes]))


def _translation(reference: Array, size: Array) -> Array | None:
    """Translation of the reference onto an image, float32 (2, 3); None if there is none."""
    middle = _centre(size) - _centre(reference)
    start = np.array([[1, 0, middle[0]], [0, 1, middle[1]]], np.float32)
    stop = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 30, 1e-3)
    try:
        _, matrix = cv2.findTransformECC(
            reference, size, start.copy(), cv2.MOTION_TRANSLATION, stop, None, 5
        )
    except cv2.error:  # it did not converge
        return None
    step: Array = np.asarray(matrix)
    return step if np.hypot(*(step - start)[:, 2]) < _ASTRAY else None


def _centre(size: Array) -> Array:
    """Centre of the change, x and y in pixels."""
    weight = np.maximum(size - 0.3 * size.max(), 0)
    y, x = np.indices(size.shape)
    out: Array = np.array([(weight * x).sum(), (weight * y).sum()]) / weight.sum()
    return out


def _slopes(pixels: Array, force: Array, places: Array, axes: Sequence[int]) -> list[float]:
    """Size of the change per newton of normal force, and of shear along each of the axes.

    Args:
        pixels: Changes (T, P), grey levels.
        force: Forces (T, 3), N.
        places: Places of the imprint (T, 2), pixels.
        axes: Axes of the fitted shear, 0 for x and 1 for y.
    """
    normal = force[:, 2] - force[:, 2].mean()
    x, y = ((places - places.mean(axis=0)) / max(float(places.std()), 1e-6)).T
    place = [x, y, x * x, y * y, x * y]
    shear = [force[:, i] for i in axes]
    by = np.stack([np.ones_like(normal), normal, *shear, normal**2, *place], axis=1)
    half = (np.arange(len(by)) // _BLOCK) % 2 == 0
    left, other = (np.linalg.lstsq(by[rows], pixels[rows], rcond=None)[0] for rows in (half, ~half))
    common = (left * other).mean(axis=1)[1 : 2 + len(axes)]
    sizes: list[float] = np.sqrt(np.maximum(common, 0)).tolist()
    return sizes
