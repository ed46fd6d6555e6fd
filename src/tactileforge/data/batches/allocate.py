"""Allocation of the clips of a batch to sources."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from tactileforge.errors import ConfigError


def allocate(
    size: int,
    sources: Sequence[tuple[str, float, frozenset[str]]],
    shares: Mapping[str, float],
) -> list[int]:
    """Allocate the clips of a batch to sources.

    Args:
        size: Number of clips to allocate.
        sources: Name, weight above 0 and labels of each source.
        shares: Smallest share of the clips from sources with a label, 0 to 1, by label.

    Returns:
        Clips of each source, at least 1; they add up to ``size``.

    Raises:
        ConfigError: More sources than clips, an invalid share, or a share without a source for it.

    Example:
        >>> allocate(8, [("a", 3, frozenset()), ("b", 1, frozenset({"force"}))], {"force": 0.5})
        [3, 5]
    """
    if not size:
        return [0] * len(sources)
    weights = np.array([weight for _, weight, _ in sources], np.float64)
    if size < len(sources):
        raise ConfigError(f"{size} clips of a batch for {len(sources)} sources; raise batch.size")
    if not (np.isfinite(weights).all() and (weights > 0).all()):
        raise ConfigError(f"weights of sources are above 0, not {weights.tolist()}")
    counts = np.zeros(len(sources), int)
    left = size
    for label, share in shares.items():
        reserved = round(share * size)
        able = np.array([label in labels for *_, labels in sources])
        if not 0 <= share <= 1 or reserved > left:
            raise ConfigError(f"batch.shares.{label} is {share}; all shares add up to at most 1")
        if reserved and not able.any():
            raise ConfigError(f"batch.shares.{label} is {share}, but no source has {label}")
        if reserved:
            counts[able] += _apportion(reserved, weights[able])
            left -= reserved
    # shares come first: what they reserve is gone before the weights divide the rest
    counts += _apportion(left, weights)
    # a small weight may round to 0 clips, and its source would never be seen: the largest lends one
    while not counts.all():
        counts[counts.argmin()] += 1
        counts[counts.argmax()] -= 1
    return [int(count) for count in counts]


def _apportion(count: int, weights: NDArray[np.float64]) -> NDArray[np.int64]:
    """Integers in proportion to weights, by the largest-remainder method."""
    exact = count * weights / weights.sum()
    out: NDArray[np.int64] = np.floor(exact).astype(np.int64)
    rest = np.argsort(out - exact, kind="stable")[: count - int(out.sum())]
    out[rest] += 1
    return out
