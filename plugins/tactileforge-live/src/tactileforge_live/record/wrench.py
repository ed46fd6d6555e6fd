"""Wrenches at the times of frames, in the axes of the gel."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from tactileforge.errors import ConfigError

#: Longest time between two samples for interpolation, s.
GAP = 0.1


def interpolate_samples(
    wanted: NDArray[np.float64],
    times: NDArray[np.float64],
    samples: NDArray[np.floating],
    gap: float = GAP,
) -> NDArray[np.float32]:
    """Interpolates samples linearly to other times.

    Args:
        wanted: Times of the result, float64 (T,), s.
        times: Times of the samples, float64 (N,), s, ascending.
        samples: Values of the samples, float (N, width).
        gap: Longest time between two samples for interpolation, s.

    Returns:
        float32 (T, width); a row of NaN without a sample on both sides, or with a longer gap
        between them.
    """
    out = np.full((len(wanted), samples.shape[1]), np.nan, np.float32)
    if len(times) < 2:
        return out
    after = np.searchsorted(times, wanted).clip(1, len(times) - 1)
    known = (wanted >= times[0]) & (wanted <= times[-1])
    known &= times[after] - times[after - 1] <= gap  # np.interp would draw a line over the gap
    for axis in range(samples.shape[1]):
        out[known, axis] = np.interp(wanted[known], times, samples[:, axis])
    return out


def axes_matrix(axes: Sequence[str]) -> NDArray[np.float64]:
    """Rotation from the axes of a wrench sensor to those of a gel, float64 (3, 3).

    Args:
        axes: Axes of the wrench sensor, with signs, along x, y and z of the gel: for example
            ``[x, -y, -z]``. See `contracts` for the axes of a gel.

    Raises:
        ConfigError: They are not three different axes, or they are a mirror image.

    Example:
        >>> (axes_matrix(["-y", "x", "z"]) @ [1.0, 2.0, 3.0]).tolist()
        [-2.0, 1.0, 3.0]
    """
    names = [str(axis).lstrip("+-") for axis in axes]
    if sorted(names) != ["x", "y", "z"]:
        raise ConfigError(f"axes={list(axes)}: name each of x, y and z once, e.g. [x, -y, -z]")
    matrix = np.zeros((3, 3))
    for row, (axis, name) in enumerate(zip(axes, names, strict=True)):
        matrix[row, "xyz".index(name)] = -1.0 if str(axis).startswith("-") else 1.0
    if np.linalg.det(matrix) < 0:
        raise ConfigError(f"axes={list(axes)} is a mirror image: change one sign, or swap two")
    return matrix


def rotate_wrenches(
    wrenches: NDArray[np.float32], matrix: NDArray[np.float64]
) -> NDArray[np.float32]:
    """Rotates wrenches (N, 6) to other axes."""
    both = [wrenches[:, :3] @ matrix.T, wrenches[:, 3:] @ matrix.T]
    return np.concatenate(both, axis=1).astype(np.float32)
