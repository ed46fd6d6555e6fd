"""Wrenches at the times of frames, in the axes of the gel."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from tactileforge.errors import ConfigError

#: Seconds between two samples above which what lies between them is not known.
GAP = 0.1


def interpolate_samples(
    wanted: NDArray[np.float64],
    times: NDArray[np.float64],
    samples: NDArray[np.floating],
    gap: float = GAP,
) -> NDArray[np.float32]:
    """Samples at other times, interpolated linearly.

    Args:
        wanted: float64 (T,), seconds.
        times: float64 (N,), seconds of the samples, ascending.
        samples: Float (N, width).
        gap: Longest time between two samples, s, over which is interpolated.

    Returns:
        float32 (T, width); a row of NaN where there is no sample on both sides, or they are too far
        apart.
    """
    out = np.full((len(wanted), samples.shape[1]), np.nan, np.float32)
    if len(times) < 2:
        return out
    after = np.searchsorted(times, wanted).clip(1, len(times) - 1)
    known = (wanted >= times[0]) & (wanted <= times[-1])
    known &= times[after] - times[after - 1] <= gap
    for axis in range(samples.shape[1]):
        out[known, axis] = np.interp(wanted[known], times, samples[:, axis])
    return out


def axes_matrix(axes: Sequence[str]) -> NDArray[np.float64]:
    """Rotation from the axes of a wrench sensor to those of a gel, float64 (3, 3).

    Args:
        axes: Which axis of the wrench sensor, with its sign, is x, y and z of the gel: for example
            ``[x, -y, -z]``. See `contracts` for the axes of a gel.

    Raises:
        ConfigError: They are not three different axes, or a mirror image.

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
    """Rotates wrenches (N, 6) into other axes."""
    both = [wrenches[:, :3] @ matrix.T, wrenches[:, 3:] @ matrix.T]
    return np.concatenate(both, axis=1).astype(np.float32)
