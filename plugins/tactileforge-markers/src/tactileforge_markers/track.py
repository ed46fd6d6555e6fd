"""Follows the printed markers of a gel from frame to frame."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from tactileforge.errors import DataError
from tactileforge_markers.find import check_picture, find_markers

#: Contrast that counts as a marker, as a share of that at rest.
_FAINT = 0.35
#: Distance within which a marker is looked for, and by which it may leave its neighbours, in
#: pitches.
_REACH, _ODD = 0.5, 0.45
#: Neighbours that say where a marker should be.
_NEIGHBORS = 6
#: Steps of the refinement, and the step in pixels that ends it.
_REFINED = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 12, 0.005)


class MarkerTracker:
    """Displacement of each marker of one gel, in consecutive frames.

    Markers are found in the reference, and keep their rows. In a frame, spots are matched with the
    markers where they were in the frame before, nearest first, and each is refined by matching its
    picture with that in the reference (Lucas and Kanade 1981). A marker that is hidden, or out of
    the picture, is NaN; its neighbours say where it may come back.

    A grid looks the same after a step of one pitch, so frames have to come before markers have
    moved by half of it.

    Args:
        reference: uint8 (H, W, 3), RGB, without contact; or markers found in one.
        what: Name of the sensor, for errors.

    Attributes:
        grid: The markers at rest.

    Raises:
        DataError: No markers are found in the reference; see `find.find_markers`.

    Example:
        >>> import cv2, numpy as np
        >>> still = np.full((120, 160, 3), 150, np.uint8)
        >>> for place in np.ndindex(4, 5):
        ...     center = 30 + 24 * place[1], 24 + 24 * place[0]
        ...     _ = cv2.circle(still, center, 4, (20, 20, 20), -1, cv2.LINE_AA)
        >>> tracker = MarkerTracker(still)
        >>> moved = tracker.read(np.roll(still, 3, axis=1))
        >>> moved.shape, np.round(moved[0]).tolist()
        ((20, 2), [3.0, 0.0])
    """

    def __init__(self, reference: NDArray[np.uint8], what: str = "the reference") -> None:
        self.what = what
        self.grid = find_markers(reference, what)
        self._still = self.grid.shares(reference)
        apart = np.hypot(*(self.grid.places[:, None] - self.grid.places[None]).transpose(2, 0, 1))
        np.fill_diagonal(apart, np.inf)  # no marker is its own neighbour
        # int64 (N, K), numbers of the neighbours of each marker
        self._near = np.argsort(apart, axis=1)[:, : min(_NEIGHBORS, len(apart) - 1)]
        x, y = np.rint(self.grid.places).astype(np.int64).T
        self._soft = float(np.median(self._softened(self._still)[y, x]))
        self._moved = np.zeros_like(self.grid.places)

    def restart(self) -> None:
        """Begins a new sequence of frames, from rest."""
        self._moved = np.zeros_like(self.grid.places)

    def read(self, frame: NDArray[np.uint8]) -> NDArray[np.float32]:
        """Displacement of each marker since the reference.

        Args:
            frame: uint8 (H, W, 3), RGB, of the size of the reference.

        Returns:
            float32 (N, 2), pixels to the right and down; NaN for a marker that is not seen.

        Raises:
            DataError: The frame is of another form or size than the reference.
        """
        check_picture(frame, self.what)
        if frame.shape[:2] != self.grid.size:
            raise DataError(
                f"{self.what}: a frame of {frame.shape[:2]} pixels, and its reference has "
                f"{self.grid.size}; give both as the sensor took them"
            )
        shares = self.grid.shares(frame)
        seen, moved = self._matched(self._spots(shares))
        moved, seen = self._refined(shares, moved, seen)
        seen &= self._smooth(moved, seen)
        self._moved = self._filled(moved, seen)
        # wholly in the picture: a marker cut off by the border has its centre elsewhere
        edge, (height, width) = self.grid.radius, self.grid.size
        x, y = (self.grid.places + self._moved).T
        seen &= (x >= edge) & (x <= width - 1 - edge) & (y >= edge) & (y <= height - 1 - edge)
        out: NDArray[np.float32] = np.where(seen[:, None], moved, np.nan).astype(np.float32)
        return out

    def _spots(self, shares: NDArray[np.uint8]) -> NDArray[np.float64]:
        """Places of spots, float64 (M, 2)."""
        soft = self._softened(shares)
        side = 2 * int(np.ceil(self.grid.radius)) + 1
        top = cv2.dilate(soft, np.ones((side, side), np.uint8))
        inner = (soft == top)[1:-1, 1:-1] & (soft[1:-1, 1:-1] > _FAINT * self._soft)
        y, x = np.nonzero(inner)
        y, x = y + 1, x + 1
        spot = soft.astype(np.float64)
        middle = spot[y, x]
        right = _vertex(spot[y, x - 1], middle, spot[y, x + 1])
        down = _vertex(spot[y - 1, x], middle, spot[y + 1, x])
        return np.stack([x + right, y + down], axis=1)

    def _softened(self, shares: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """Spots without noise and speckles in them, each with one top."""
        return np.asarray(
            cv2.GaussianBlur(shares, (0, 0), max(0.7, 0.5 * self.grid.radius)), np.uint8
        )

    def _matched(self, found: NDArray[np.float64]) -> tuple[NDArray[np.bool_], NDArray[np.float64]]:
        """Markers with a near spot of their own, and displacements of all."""
        seen = np.zeros(len(self._moved), bool)
        moved = self._moved.copy()
        if not len(found):
            return seen, moved
        for _ in range(2):  # again, from where the neighbours have gone
            expected = self.grid.places + moved
            apart = np.hypot(*(expected[:, None] - found[None]).transpose(2, 0, 1))
            spot = apart.argmin(1)
            mutual = apart.argmin(0)[spot] == np.arange(len(expected))
            seen = mutual & (apart.min(1) < _REACH * self.grid.pitch)
            moved = np.where(seen[:, None], found[spot] - self.grid.places, moved)
            seen &= self._smooth(moved, seen)
            moved = self._filled(moved, seen)
        return seen, moved

    def _refined(
        self, shares: NDArray[np.uint8], moved: NDArray[np.float64], seen: NDArray[np.bool_]
    ) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
        """Displacements refined by the picture of each marker at rest."""
        if not seen.any():
            return moved, seen
        side = 2 * int(np.ceil(self.grid.radius + 1)) + 1
        start = self.grid.places[seen].astype(np.float32)[:, None]
        guess = (self.grid.places + moved)[seen].astype(np.float32)[:, None]
        # no pyramid: spots have already told the place to less than a radius
        there, good, _ = cv2.calcOpticalFlowPyrLK(
            self._still,
            shares,
            start,
            guess.copy(),
            winSize=(side, side),
            maxLevel=0,
            criteria=_REFINED,
            flags=cv2.OPTFLOW_USE_INITIAL_FLOW,
        )
        step = np.hypot(*(there - guess)[:, 0].T)
        good = (good[:, 0] > 0) & (step < max(1.0, 0.6 * self.grid.radius))
        out = moved.copy()
        rows = np.flatnonzero(seen)[good]
        out[rows] = there[good, 0] - self.grid.places[rows]
        return out, seen

    def _smooth(self, moved: NDArray[np.float64], seen: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Markers in motion like their neighbours."""
        around = np.sort(np.where(seen[:, None], moved, np.inf)[self._near], axis=1)
        count = seen[self._near].sum(1)
        rows = np.arange(len(moved))
        last = around.shape[1] - 1
        # a median of the seen neighbours alone: the hidden ones were sorted to the end as infinity
        middle = around[rows, (count // 2).clip(max=last)] / 2
        middle += around[rows, ((count - 1) // 2).clip(0)] / 2
        away = np.hypot(*(moved - middle).T)
        return np.asarray((count == 0) | (away < _ODD * self.grid.pitch))

    def _filled(self, moved: NDArray[np.float64], seen: NDArray[np.bool_]) -> NDArray[np.float64]:
        """Displacements, those of hidden markers from their nearest seen neighbours."""
        out = moved.copy()
        lost = np.flatnonzero(~seen)
        if not len(lost) or not seen.any():
            return out
        known = np.flatnonzero(seen)
        gap = self.grid.places[lost][:, None] - self.grid.places[known][None]
        apart = np.hypot(*gap.transpose(2, 0, 1))
        few = np.argsort(apart, axis=1)[:, :_NEIGHBORS]
        # the nearest count most
        weight = 1 / (np.take_along_axis(apart, few, 1) + 1e-6)
        out[lost] = (weight[..., None] * moved[known[few]]).sum(1) / weight.sum(1)[:, None]
        return out


def _vertex(
    before: NDArray[np.float64], middle: NDArray[np.float64], after: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Place of the top of a parabola through three points, from the middle one, -0.5 to 0.5."""
    bend = 2 * middle - before - after
    return np.where(bend > 0, (after - before) / np.maximum(2 * bend, 1e-9), 0.0).clip(-0.5, 0.5)
