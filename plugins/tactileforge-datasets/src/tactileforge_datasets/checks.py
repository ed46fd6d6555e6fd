"""Checks of values and names in files of others."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactileforge.data import check_rising
from tactileforge.errors import DataError, unknown

#: Columns of a pose: place in mm, and quaternion.
POSE = ("x_mm", "y_mm", "z_mm", "quat_x", "quat_y", "quat_z", "quat_w")


def value_of(values: Mapping[str, Any], key: str, where: str) -> Any:
    """A value by its key.

    Args:
        values: Values by key.
        key: Name of the value.
        where: File, and place in it, for the message.

    Raises:
        DataError: The key is missing; names the nearest one.
    """
    if key not in values:
        raise DataError(f"{where}: {unknown('key', key, map(str, values), 'Download it again')}")
    return values[key]


def numbers(
    values: Any, shape: tuple[int | None, ...], what: str, where: str, empty: bool = False
) -> NDArray[np.float64]:
    """Finite numbers of a shape.

    Args:
        values: Nested lists, or an array.
        shape: Expected shape; None for any length above 0.
        what: Name of the values.
        where: File, and place in it, for the message.
        empty: Whether NaN is allowed, for no value.

    Raises:
        DataError: The values are not numbers, infinite, or of another shape; gives both shapes.
    """
    try:
        array = np.asarray(values, np.float64)
    except (TypeError, ValueError) as error:
        raise DataError(f"{where}: {what} is not numbers of one shape ({error})") from error
    fits = array.ndim == len(shape) and array.size > 0
    if not fits or any(n not in (None, m) for n, m in zip(shape, array.shape, strict=True)):
        expected = ", ".join("any" if n is None else str(n) for n in shape)
        raise DataError(
            f"{where}: {what} has shape {array.shape}, where ({expected}) belongs; "
            "download it again"
        )
    if not (np.isfinite(array) | (np.isnan(array) if empty else False)).all():
        raise DataError(f"{where}: {what} has values that are not numbers; download it again")
    return array


def pose_track(pose: NDArray[np.float64]) -> dict[str, NDArray[np.float32]]:
    """The track ``pose`` of a single frame, in m; none without a number.

    Args:
        pose: float64 (7,), values of `POSE`.
    """
    if not np.isfinite(pose).any():
        return {}
    return {"pose": (pose * [*[0.001] * 3, *[1] * 4])[None].astype(np.float32)}


def rising(times: NDArray[np.float64], where: str) -> NDArray[np.float64]:
    """Times from 0, s.

    Args:
        times: float64 (T,), s.
        where: File, and place in it, for the message.

    Raises:
        DataError: A time is not after the one before.
    """
    check_rising(times, where, "sort the rows, or download it again", row="row", shown="{:.6f} s")
    from_zero: NDArray[np.float64] = times - times[0]
    return from_zero


def same_length(counts: Mapping[str, int], where: str) -> int:
    """The one length of several parts of a recording.

    Args:
        counts: Length by name of the part.
        where: File or folder, for the message.

    Raises:
        DataError: Lengths differ, or are 0.
    """
    if len(set(counts.values())) != 1 or 0 in counts.values():
        said = ", ".join(f"{count} {name}" for name, count in counts.items())
        raise DataError(
            f"{where}: {said}; they have to be as many, and 1 or more; download it again"
        )
    return next(iter(counts.values()))


def pressing_sign(normal: Iterable[float]) -> float:
    """Sign of positive normal forces on average: a probe presses, and does not pull.

    Args:
        normal: Normal forces of the source, N; NaN for no label.

    Example:
        >>> pressing_sign([0.0, -3.0, -1.0, float("nan")]), pressing_sign([])
        (-1.0, 1.0)
    """
    values = np.fromiter(normal, np.float64)
    values = values[np.isfinite(values)]
    return -1.0 if len(values) and values.mean() < 0 else 1.0


def inside(root: Path, name: str, where: str) -> Path:
    """A file of the data set by its relative path.

    Raises:
        DataError: The path is empty, absolute or leads out of the folder.
    """
    path = Path(name)
    if not name or path.is_absolute() or ".." in path.parts:
        raise DataError(f"{where}: {name!r} is not a path inside of {root}; correct it")
    return root / path


def word_before_number(name: str) -> str:
    """A name without the number at its end.

    Example:
        >>> word_before_number("avocado1"), word_before_number("sphere_12"), word_before_number("7")
        ('avocado', 'sphere', '7')
    """
    return name.rstrip("0123456789").rstrip("_-") or name
