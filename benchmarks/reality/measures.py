"""Image statistics of one touch: spectrum, noise, contact, contrast, colour.

Images are float32 (H, W, 3) in grey levels of 255, at most `SIDE` pixels on their shorter side,
and a change is an image minus the image without contact. Frequencies are cycles per pixel of an
image whose shorter side is `SIDE`.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any, TypeAlias

import cv2
import numpy as np
from numpy.typing import NDArray

Array: TypeAlias = NDArray[Any]

#: Shorter side of compared images, pixels.
SIDE = 240
#: Edges of the bands of frequency, cycles per pixel.
BANDS = (0.06, 0.12, 0.2, 0.3, 0.5)
#: Upper end of the reference band, cycles per pixel: the imprint as a whole. Band powers are
#: relative to the power below it.
LOW = 0.03
#: Centres of the rings of a spectrum, cycles per pixel.
RINGS = (np.arange(40) + 0.5) / 80
#: Detection of contact: standard deviation of the blur, pixels, and threshold as a share of the
#: largest change.
_BLUR, _SHARE = 3.0, 0.3
#: Least change of a measurable touch after the blur, grey levels.
FAINT = 5.0
#: Standard deviation of the blur for fine detail, the difference from the blurred image, pixels.
_FINE = 2.0
#: Width of the ignored rim around the contact, pixels.
_BORDER = 16


def sized(picture: Array) -> NDArray[np.float32]:
    """The image, averaged down to a shorter side of `SIDE`; smaller images are unchanged.

    Args:
        picture: (H, W, 3), grey levels.
    """
    height, width = picture.shape[:2]
    scale = SIDE / min(height, width)
    out = picture.astype(np.float32)
    if scale < 1:
        size = (round(width * scale), round(height * scale))
        out = cv2.resize(out, size, interpolation=cv2.INTER_AREA).astype(np.float32)
    return out


def density(change: Array) -> tuple[Array, Array]:
    """Power density of the grey change under a Hann window.

    Args:
        change: float32 (H, W, 3), grey levels.

    Returns:
        Frequencies (H, W) in cycles per pixel, and powers (H, W) in squared grey levels: white
        noise of variance v, equal in all channels, has power v everywhere.
    """
    grey = change.mean(axis=-1, dtype=np.float64)
    height, width = grey.shape
    window = np.hanning(height)[:, None] * np.hanning(width)
    grey = (grey - np.average(grey, weights=window)) * window
    power = np.abs(np.fft.fft2(grey)) ** 2 / np.square(window).sum()
    far = np.hypot(np.fft.fftfreq(height)[:, None], np.fft.fftfreq(width))
    return far * (min(height, width) / SIDE), power


def _finest(change: Array) -> float:
    """Highest frequency along the sides, cycles per pixel."""
    return float(0.5 * min(change.shape[:2]) / SIDE)


def radial(change: Array) -> Array:
    """Mean power density in rings around `RINGS`, squared grey levels; NaN beyond the pixels."""
    far, power = density(change)
    ring = (far * 2 * len(RINGS)).astype(int)
    kept = (ring < len(RINGS)) & (far <= _finest(change))
    total = np.bincount(ring[kept], power[kept], len(RINGS))
    count = np.bincount(ring[kept], minlength=len(RINGS))
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def bands(change: Array) -> Array:
    """Log10 of the mean power density in each of `BANDS`, relative to the power below `LOW`.

    Returns:
        float64 (4,), decades; NaN for a band beyond the pixels' resolution.
    """
    far, power = density(change)
    low = power[far < LOW].mean()
    ratios = []
    for start, stop in pairwise(BANDS):
        seen = power[(far >= start) & (far < stop)]
        reached = _finest(change) >= stop and low > 0 and seen.mean() > 0
        ratios.append(np.log10(seen.mean() / low) if reached else np.nan)
    return np.array(ratios)


def noise(still: Sequence[Array]) -> float:
    """Standard deviation over time of a pixel without contact, grey levels.

    It is half the variance of the difference of neighbouring frames over the image, its mean
    removed to exclude flicker of the whole light. The median over the pairs of frames leaves out
    pairs with motion.

    Args:
        still: Frames in order, without contact; the result is NaN for fewer than two.
    """
    steps = (np.subtract(after, before, dtype=np.float32) for before, after in pairwise(still))
    deviations = [np.sqrt(step.var(axis=(0, 1)).mean() / 2) for step in steps]
    return float(np.median(deviations or [np.nan]))


def smooth(change: Array) -> Array:
    """Size of the change after a blur, float32 (H, W), the mean of the channels."""
    scale = min(change.shape[:2]) / SIDE
    blurred = cv2.GaussianBlur(change, (0, 0), max(_BLUR * scale, 0.5))
    out: Array = np.abs(blurred).mean(axis=-1)
    return out


def contact(change: Array) -> NDArray[np.bool_]:
    """Mask of the contact in an image, bool (H, W); empty if the change is faint."""
    size = smooth(change)
    top = float(np.quantile(size, 0.999))
    return size > (_SHARE * top if top >= FAINT else np.inf)


def contrast(change: Array, touched: NDArray[np.bool_]) -> float:
    """Mean absolute change in the contact, grey levels."""
    return float(np.abs(change[touched]).mean())


def detail(change: Array, touched: NDArray[np.bool_]) -> tuple[float, float]:
    """Deviation of the fine detail of the grey change inside and outside the contact.

    Fine detail is removed by a blur of 2 pixels: above about 0.1 cycles per pixel.

    Returns:
        Inside and outside, grey levels; NaN for an empty region.
    """
    grey = change.mean(axis=-1)
    scale = min(grey.shape) / SIDE
    fine = grey - cv2.GaussianBlur(grey, (0, 0), max(_FINE * scale, 0.3))
    border = 2 * round(_BORDER * scale) + 1
    near = cv2.dilate(touched.astype(np.uint8), np.ones((border, border), np.uint8)) > 0
    inside, outside = fine[touched], fine[~near]
    return _rms(inside), _rms(outside)


def fine_share(change: Array) -> float:
    """Fine detail of the grey change in the contact, over its contrast; NaN for a faint touch.

    Medians of real sets are 0.04 to 0.2, see docs/simulator.md. Lines of one pixel along edges and
    grain over a whole face lie above.
    """
    touched = contact(change)
    return detail(change, touched)[0] / contrast(change, touched) if touched.any() else np.nan


def _rms(values: Array) -> float:
    return float(np.sqrt(np.square(values, dtype=np.float64).mean())) if values.size else np.nan


def covariance(change: Array, touched: NDArray[np.bool_]) -> Array:
    """Covariance (3, 3) of the change of red, green and blue over the contact, grey levels^2."""
    return np.cov(change[touched].astype(np.float64), rowvar=False)


def distance(ours: Array, theirs: Array) -> float:
    """Wasserstein-1 distance between two samples of a number.

    0 for equal samples; for samples that differ by a constant, its absolute value.

    Args:
        ours: Sample (n,); NaN is left out.
        theirs: Sample (m,); NaN is left out.

    Returns:
        Distance in the unit of the samples; NaN if one of them is empty.
    """
    a, b = (np.sort(sample[np.isfinite(sample)]) for sample in (ours, theirs))
    if not len(a) or not len(b):
        return float("nan")
    at = np.sort(np.concatenate([np.arange(1, len(sample) + 1) / len(sample) for sample in (a, b)]))
    width = np.diff(at, prepend=0.0)
    middle = at - width / 2
    rows = [np.minimum((middle * len(sample)).astype(int), len(sample) - 1) for sample in (a, b)]
    return float((width * np.abs(a[rows[0]] - b[rows[1]])).sum())
