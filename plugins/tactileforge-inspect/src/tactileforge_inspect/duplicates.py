"""Exact and near duplicates among recordings."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tactileforge.data import ELSEWHERE, NO_CONTACT, SIMILAR
from tactileforge_inspect.frame_stats import FrameStats


def identical_groups(looks: Sequence[FrameStats]) -> list[list[int]]:
    """Groups of recordings with identical pixels in the decoded frames."""
    groups: dict[bytes, list[int]] = {}
    for i, seen in enumerate(looks):
        groups.setdefault(seen.digest, []).append(i)
    return [group for group in groups.values() if len(group) > 1]


def similar_pairs(looks: Sequence[FrameStats]) -> list[tuple[int, int, float]]:
    """Pairs of nearly identical recordings, compared at the same shares of their time.

    Recordings without contact look alike, and are left out.

    Args:
        looks: Decoded frames of recordings.

    Returns:
        Two numbers of recordings, and the largest difference in all but 0.5 % of their images, grey
        levels; closest first.
    """
    chosen = [i for i, seen in enumerate(looks) if seen.contact >= NO_CONTACT]
    if len(chosen) < 2:
        return []
    pictures = np.stack([looks[i].signature.ravel() for i in chosen])
    means = pictures.mean(axis=1)
    pairs = []
    for place, i in enumerate(chosen):
        # similar pictures have similar means: one number each rules out most pairs
        near = np.flatnonzero(np.abs(means[place + 1 :] - means[place]) < SIMILAR) + place + 1
        close = (np.abs(pictures[near] - pictures[place]) >= SIMILAR).mean(axis=1) < ELSEWHERE
        # exact ones are told by their digests, as groups
        for other in near[close].tolist():
            j = chosen[other]
            if looks[i].digest != looks[j].digest and looks[i].shape == looks[j].shape:
                level = np.quantile(np.abs(pictures[other] - pictures[place]), 1 - ELSEWHERE)
                pairs.append((i, j, float(level)))
    return sorted(pairs, key=lambda pair: pair[2])
