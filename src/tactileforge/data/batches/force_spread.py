"""Spread of forces in the training data."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tactileforge.contracts import TrainingClips

#: Smallest deviation of an axis, as a share of the largest one. A data set of pure presses has
#: nothing but noise along x and y; dividing by its deviation would make the model learn it.
_LEAST = 0.05


def force_spread(clips: TrainingClips) -> NDArray[np.float32]:
    """Standard deviations of force, and of its change between the frames of a clip.

    One pass over the labels, in the order of the recordings (for sources read window by window,
    over the recordings at hand), so that all ranks agree.

    Args:
        clips: Training clips; no image is read.

    Returns:
        float32 (2, 3): force and change along x, y and z, in units of the sensors' force scales; 1
        without labels.
    """
    moments = np.zeros((2, 3, 3))  # count, sum and sum of squares along each axis
    for number, recording in enumerate(clips.recordings):
        if recording.force is None:
            continue
        force = recording.force.astype(np.float64) / clips.scales[recording.sensor]
        # the change that a clip shows, which depends on the rate of the recording
        step = int(clips.strides[number])
        for row, values in enumerate((force, force[step:] - force[:-step])):
            known = np.isfinite(values)
            values = np.where(known, values, 0.0)
            moments[row] += np.stack([known.sum(0), values.sum(0), (values**2).sum(0)])
    count, total, squares = moments.transpose(1, 0, 2)
    mean = total / count.clip(min=1)
    spread = np.sqrt((squares / count.clip(min=1) - mean**2).clip(min=0))
    spread = np.maximum(spread, _LEAST * spread.max(axis=1, keepdims=True))
    return np.where((count > 0) & (spread > 0), spread, 1.0).astype(np.float32)
