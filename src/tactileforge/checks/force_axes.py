"""Exchanged axes of forces: shear with the size and sign of pressing."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

#: Smallest share of the largest force in contact.
_CONTACT = 0.2
#: Rows in contact from which axes can be told.
_ROWS = 10
#: Smallest share of one sign of pressing, and largest of a shear that comes from all sides.
_ONE_SIGN, _MIXED = 0.95, 0.9
#: Ratio of shear to pressing beyond the friction of gels in a slide to one side.
_FRICTION = 2.0


class ForceAxes:
    """Sizes and signs of forces in contact, by axis."""

    def __init__(self) -> None:
        self._rows = 0
        self._size, self._positive, self._negative = np.zeros((3, 3))

    def add(self, force: NDArray[np.floating]) -> None:
        """Take the rows in contact.

        Args:
            force: Forces, (T, 3), N; NaN for a missing one.
        """
        known = force[np.isfinite(force).all(axis=1)].astype(np.float64)
        size = np.linalg.norm(known, axis=1)
        if not len(known) or not size.any():
            return
        touching = known[size > _CONTACT * size.max()]
        self._rows += len(touching)
        self._size += np.abs(touching).sum(axis=0)
        self._positive += (touching > 0).sum(axis=0)
        self._negative += (touching < 0).sum(axis=0)

    def pressing(self) -> str:
        """Axis of pressing in place of z, ``x`` or ``y``; "" for z, or with few rows.

        Example:
            >>> axes = ForceAxes()
            >>> axes.add(np.linspace([1, -0.4, 0.3], [9, 0.2, -0.5], 30))
            >>> axes.pressing()
            'x'
        """
        if self._rows < _ROWS:
            return ""
        signs = np.maximum(self._positive, self._negative) / self._rows
        x_or_y = int(self._size[:2].argmax())
        is_larger = self._size[x_or_y] > self._size[2]
        is_pressing = signs[x_or_y] >= _ONE_SIGN and is_larger
        is_shear = signs[2] < _MIXED or self._size[x_or_y] > _FRICTION * self._size[2]
        return "xy"[x_or_y] if is_pressing and is_shear else ""

    @property
    def ratio(self) -> float:
        """Largest mean shear over the mean normal force."""
        return float(self._size[:2].max() / max(self._size[2], 1e-12))
