"""Statistics for LeRobot's normalisation."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from tactileforge.contracts import Frames

_QUANTILES = {"q01": 0.01, "q10": 0.1, "q50": 0.5, "q90": 0.9, "q99": 0.99}
#: Largest number of sampled images of an episode, and their longer side, pixels.
_PICTURES, _SIDE = 8, 32


def number_statistics(values: NDArray[Any]) -> dict[str, list[Any]]:
    """Statistics of each column, over the rows with finite values alone.

    Args:
        values: Numbers, (N, ...).
    """
    rows = np.asarray(values, np.float64).reshape(len(values), -1)
    rows = rows[np.isfinite(rows).all(1)]
    if not len(rows):
        rows = np.zeros((1, rows.shape[1]))
    values_of = {
        "min": rows.min(0),
        "max": rows.max(0),
        "mean": rows.mean(0),
        "std": rows.std(0),
        **{name: np.quantile(rows, share, 0) for name, share in _QUANTILES.items()},
    }
    return {name: value.tolist() for name, value in values_of.items()} | {"count": [len(rows)]}


def image_statistics(small: NDArray[np.uint8]) -> dict[str, list[Any]]:
    """Statistics of each colour, in 0..1, as nested lists (3, 1, 1).

    Args:
        small: Sampled frames, uint8 (N, h, w, 3); see `sample_frames`.
    """
    numbers = number_statistics(small.reshape(-1, 3) / 255)
    shaped = {
        name: [[[value]] for value in values] for name, values in numbers.items() if name != "count"
    }
    return shaped | {"count": [len(small)]}


def sample_frames(frames: Frames) -> NDArray[np.uint8]:
    """Samples some frames of an episode evenly, and shrinks them.

    Returns:
        uint8 (n, h, w, 3).
    """
    rows = np.linspace(0, len(frames) - 1, min(len(frames), _PICTURES)).astype(int)
    chosen = frames.read(rows.tolist())
    height, width = frames.shape
    scale = min(1.0, _SIDE / max(height, width))
    size = (max(1, round(width * scale)), max(1, round(height * scale)))
    return np.stack([cv2.resize(image, size, interpolation=cv2.INTER_AREA) for image in chosen])
