"""Patches of difference images in contact, and the inputs of a classifier."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from reality.measures import Array
from reality.touches import strongest_touches
from tactileforge.contracts import Recording

#: Rows and columns of a patch.
PATCH = 48
#: Edges of the bands of a patch's spectrum, cycles per pixel; each wider than its resolution.
_BANDS = (0.03, 0.06, 0.09, 0.12, 0.16, 0.2, 0.25, 0.3, 0.36, 0.43, 0.5)
#: Floor of a power, squared grey levels: a sixteenth of a grey level counts as nothing.
_FLOOR = 1 / 256


def patches(
    recordings: Iterable[Recording], each: int, most: int = 8, seed: int = 0
) -> NDArray[np.float32]:
    """Cuts patches centred in the contact out of change images.

    Args:
        recordings: Recordings of one source.
        each: Number of patches per image.
        most: Largest number of images per recording.
        seed: Seed of the places.

    Returns:
        float32 (N, 48, 48, 3), grey levels. The shorter side of an image is at most 240 pixels.

    Raises:
        DataError: A recording cannot be read.
    """
    chance = np.random.default_rng(seed)
    cut = []
    for recording in recordings:
        for touch in strongest_touches(recording, most):
            # Centres far enough from the border that the whole patch lies in the image.
            half = PATCH // 2
            inner = touch.touched[half : touch.touched.shape[0] - half, half:-half]
            rows, columns = np.nonzero(inner)
            if not len(rows):
                continue
            change = touch.change
            for place in chance.integers(len(rows), size=each):
                top, left = rows[place], columns[place]
                cut.append(change[top : top + PATCH, left : left + PATCH])
    return np.stack(cut) if cut else np.empty((0, PATCH, PATCH, 3), np.float32)


def patch_colours(cut: Array) -> Array:
    """Means and covariances of the channels of each patch, (N, 9).

    Variances are logarithms and covariances are correlations, so that all have one scale.
    """
    flat = cut.reshape(len(cut), -1, 3).astype(np.float64)
    mean = flat.mean(axis=1)
    away = flat - mean[:, None]
    covariance = np.einsum("npc,npd->ncd", away, away) / flat.shape[1]
    deviation = np.sqrt(np.einsum("ncc->nc", covariance) + _FLOOR)
    shared = covariance / (deviation[:, :, None] * deviation[:, None])
    return np.concatenate(
        [mean, np.log(deviation), shared[:, [0, 0, 1], [1, 2, 2]]], axis=1
    ).astype(np.float32)


def patch_spectra(cut: Array) -> Array:
    """Logarithms of the mean power of each patch's grey change in ten bands, (N, 10)."""
    grey = cut.mean(axis=-1, dtype=np.float64)
    line = np.hanning(PATCH + 2)[1:-1]
    window = line[:, None] * line
    grey = (grey - np.tensordot(grey, window / window.sum(), 2)[:, None, None]) * window
    power = np.abs(np.fft.fft2(grey)) ** 2 / np.square(window).sum()
    far = np.hypot(np.fft.fftfreq(PATCH)[:, None], np.fft.fftfreq(PATCH))
    rings = [(far >= a) & (far < b) for a, b in pairwise(_BANDS)]
    means = np.stack([power[:, ring].mean(axis=1) for ring in rings], axis=1)
    out: Array = np.log(means + _FLOOR).astype(np.float32)
    return out
