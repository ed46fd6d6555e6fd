"""Taxel layouts: drawing of arrays of taxels as images."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from tactileforge.errors import ConfigError

#: Value of a pixel without change.
REST = 128


class TaxelLayout:
    """Positions of taxels in an image, and the mapping of their values to colours.

    Red, green and blue are x, y and z. A value at the baseline is `REST`; a value ``span`` or more
    above or below it is 255 or 1. A pixel on a taxel shows that taxel; others show the mean of all,
    weighted by the inverse square of the distance (Shepard, 1968).

    Args:
        shape: Rows and columns of the picture.
        positions: Row and column of each taxel, also between pixels; None for a grid filling the
            picture row by row.
        channels: Columns of the values x, y and z of a taxel; a single one is z.
        span: Change from the baseline to full colour, for all axes or for each.

    Raises:
        ConfigError: Invalid number of axes, position or span.

    Example:
        >>> layout = TaxelLayout((1, 2), channels=[0], span=10.0)
        >>> layout.draw(np.array([[5.0], [30.0]]), np.array([[0.0], [30.0]]))[..., 2].tolist()
        [[192, 128]]
    """

    def __init__(
        self,
        shape: Sequence[int],
        positions: Sequence[Sequence[float]] | None = None,
        channels: Sequence[int] = (0, 1, 2),
        span: float | Sequence[float] = 1.0,
    ) -> None:
        rows, columns = (int(size) for size in shape)
        if rows < 1 or columns < 1:
            raise ConfigError(f"a picture of {rows} x {columns} taxels: give 1 or more of each")
        if len(channels) not in (1, 3):
            raise ConfigError(f"channels={list(channels)}: give one value (z), or three (x, y, z)")
        spans = np.broadcast_to(np.asarray(span, np.float64), (len(channels),))
        if not (spans > 0).all():
            raise ConfigError(f"span={span}: give values above 0")
        self.shape = (rows, columns)
        self.channels = [int(channel) for channel in channels]
        self.taxels = rows * columns if positions is None else len(positions)
        self._colours = [2] if len(channels) == 1 else [0, 1, 2]
        self._scale = (REST - 1) / spans
        self._weights = None if positions is None else _weights(self.shape, positions)

    def draw(
        self, values: NDArray[np.floating], baseline: NDArray[np.floating]
    ) -> NDArray[np.uint8]:
        """Draw values as an image.

        Args:
            values: float (taxels, values of each).
            baseline: Values without contact, float (taxels, values of each).

        Returns:
            uint8 (rows, columns, 3).
        """
        change = (values - baseline)[:, self.channels] * self._scale
        if self._weights is not None:
            change = self._weights @ change
        out = np.full((*self.shape, 3), REST, np.uint8)
        drawn = np.rint(REST + change).clip(1, 255).astype(np.uint8)
        out[..., self._colours] = drawn.reshape(*self.shape, len(self._colours))
        return out


def _weights(shape: tuple[int, int], positions: Sequence[Sequence[float]]) -> NDArray[np.float64]:
    """Weight of each taxel in each pixel, float64 (pixels, taxels); rows sum to 1."""
    places = np.asarray(positions, np.float64)
    if places.ndim != 2 or places.shape[1] != 2 or not len(places):
        raise ConfigError("positions are a row and a column for each taxel: [[0, 1], ...]")
    if (places < 0).any() or (places > np.array(shape) - 1).any():
        raise ConfigError(f"a position lies outside the picture of {shape[0]} x {shape[1]} pixels")
    pixels = np.indices(shape).reshape(2, -1).T
    squares = ((pixels[:, None] - places[None]) ** 2).sum(-1)
    on_it = squares == 0
    weights = np.where(on_it.any(1, keepdims=True), on_it, 1 / np.where(on_it, 1.0, squares))
    shares: NDArray[np.float64] = weights / weights.sum(1, keepdims=True)
    return shares
