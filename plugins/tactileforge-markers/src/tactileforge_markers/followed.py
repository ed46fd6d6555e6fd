"""Markers of a recording, followed while it is packed."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactileforge.contracts import Recording
from tactileforge.errors import DataError
from tactileforge_markers.track import MarkerTracker
from tactileforge_markers.tracks import marker_labels, marker_tracks


class FollowedMarkers:
    """Displacement of the markers in the frames of one recording.

    Args:
        recording: Recording of a gel with printed dots.

    Raises:
        DataError: It has no frame without contact, none of the size of its frames, or none with
            markers.
    """

    def __init__(self, recording: Recording) -> None:
        self.recording = recording
        reference = recording.background()
        if reference is None:
            raise DataError(
                f"{recording.key}: no frame without contact, so that markers have no rest; give "
                "its reader one (docs/data.md, background)"
            )
        if reference.shape[:2] != tuple(recording.frames.shape):
            raise DataError(
                f"{recording.key}: frames of {tuple(recording.frames.shape)} pixels, and a frame "
                f"without contact of {reference.shape[:2]}; give both as the sensor took them"
            )
        self._tracker = MarkerTracker(reference, recording.key)
        self._moved: dict[int, NDArray[np.float32]] = {}

    def follow(self, shown: Iterator[tuple[int, Any]]) -> Iterator[tuple[int, Any]]:
        """Follows the markers in passing frames.

        Args:
            shown: Numbers and frames in their order; encoded ones are decoded for this alone.
        """
        # before frames without change are left out: a gap would lose the markers
        for row, frame in shown:
            try:
                whole = self.recording.frames
                picture = whole.read([row])[0] if isinstance(frame, bytes) else frame
                self._moved[row] = self._tracker.read(picture)
            except DataError:  # an encoded frame is kept as it lies there, whole or not
                count = len(self._tracker.grid.places)
                self._moved[row] = np.full((count, 2), np.nan, np.float32)
            yield row, frame

    def added(self, kept: Recording, rows: Sequence[int]) -> Recording:
        """A recording with the tracks and the label of markers.

        Args:
            kept: Recording of the frames that are kept.
            rows: Their numbers.
        """
        tracks = marker_tracks(self._tracker.grid, [self._moved[row] for row in rows])
        return replace(
            kept,
            tracks={**kept.tracks, **tracks},
            labels={**kept.labels, **marker_labels(self._tracker.grid)},
        )
