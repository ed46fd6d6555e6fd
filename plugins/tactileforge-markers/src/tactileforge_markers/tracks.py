"""Markers as tracks and labels of a recording."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactileforge.contracts import Recording, Sensor
from tactileforge.errors import ConfigError, DataError, check_names
from tactileforge_markers.find import MarkerGrid
from tactileforge_markers.motion import displacement_field, marker_motion

#: Label with the markers at rest.
REST = "marker_rest"
#: Stored numbers are multiples of this, which is short as text.
_STEP = 1 / 64


def marker_tracks(grid: MarkerGrid, moved: Sequence[NDArray[np.floating]]) -> dict[str, Any]:
    """Tracks of a recording.

    Args:
        grid: Markers at rest.
        moved: Displacements in each frame, float (N, 2), pixels; see `track.MarkerTracker.read`.

    Returns:
        ``markers`` float32 (T, N, 2), pixels; ``marker_field`` float32 (T, 12, 12, 2), see
        `motion.displacement_field`; ``marker_motion`` float32 (T, 4): shear to the right and down,
        pixels, torsion, degrees, and divergence, percent, see `motion.marker_motion`. NaN where
        nothing is seen.
    """
    sums = [marker_motion(grid.places, one) for one in moved]
    fields = [displacement_field(grid.places, one, grid.size, grid.pitch) for one in moved]
    return {
        "markers": _short(np.stack(list(moved))),
        "marker_field": _short(np.stack(fields)),
        "marker_motion": _short(np.array([(*m.shear, m.torsion, m.divergence) for m in sums])),
    }


def marker_labels(grid: MarkerGrid) -> dict[str, str]:
    """The label ``marker_rest``: height and width of the picture, then x,y of each marker."""
    # a label is text or a number, so a table of places is text
    places = " ".join(f"{x:.2f},{y:.2f}" for x, y in grid.places.tolist())
    return {REST: f"{grid.size[0]}x{grid.size[1]} {places}"}


def marker_rest(recording: Recording) -> tuple[NDArray[np.float64], tuple[int, int]]:
    """Places of a recording's markers at rest, (N, 2), pixels, and the picture's height and width.

    The size is that of the pictures in which markers were followed: those of a packed recording may
    be smaller.

    Raises:
        DataError: The recording has no markers, or its label is damaged.
    """
    text = recording.labels.get(REST)
    if not isinstance(text, str):
        raise DataError(
            f"{recording.key}: no markers; record with markers=[SENSOR], or pack with "
            "pack.markers=[SENSOR]"
        )
    try:
        size, *places = text.split(" ")
        height, width = map(int, size.split("x"))
        found = np.array([[float(x) for x in place.split(",")] for place in places], np.float64)
        if found.ndim != 2 or found.shape[1] != 2 or not np.isfinite(found).all():
            raise ValueError("places are pairs of numbers")
    except ValueError as error:
        raise DataError(f"{recording.key}: the label {REST} is damaged ({error})") from error
    return found, (height, width)


def check_marker_sensors(given: Collection[str], sensors: Mapping[str, Sensor]) -> None:
    """Checks the cameras named for markers.

    Args:
        given: Names of sensors with markers.
        sensors: Sensors by name.

    Raises:
        ConfigError: No sensor has that name, or it is not a camera.
    """
    check_names("sensor of markers", given, sensors)
    for name in given:
        if (kind := sensors[name].spec.kind) != "image":
            raise ConfigError(
                f"markers: {name} ({kind}) is not a camera, and has no dots to follow"
            )


def _short(values: NDArray[Any]) -> NDArray[np.float32]:
    rounded: NDArray[np.float32] = (np.rint(values / _STEP) * _STEP).astype(np.float32)
    return rounded
