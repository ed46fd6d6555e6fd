"""Exact and near duplicates among recordings."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tactileforge.inspection.checks import NO_CONTACT
from tactileforge.inspection.frame_stats import FrameStats

#: Grey levels. The same frames encoded again differ by less nearly everywhere in small images.
SIMILAR = 3.0
#: Share of the images that may differ by more: less than the least contact covers.
_ELSEWHERE = 0.005


def identical_groups(looks: Sequence[FrameStats]) -> list[list[int]]:
    """Groups of recordings whose frames, as far as they were looked at, have the same pixels."""
    groups: dict[bytes, list[int]] = {}
    for i, seen in enumerate(looks):
        groups.setdefault(seen.digest, []).append(i)
    return [group for group in groups.values() if len(group) > 1]


def similar_pairs(looks: Sequence[FrameStats]) -> list[tuple[int, int, float]]:
    """Pairs that differ by little at the same places in time, but are not the same.

    Recordings that are never in contact look alike, and are left out.

    Args:
        looks: The decoded frames of recordings.

    Returns:
        Two numbers of recordings, and by how many grey levels all but 0.5 % of their images
        differ at most; closest first.
    """
    chosen = [i for i, seen in enumerate(looks) if seen.contact >= NO_CONTACT]
    if len(chosen) < 2:
        return []
    pictures = np.stack([looks[i].signature.ravel() for i in chosen])
    means = pictures.mean(axis=1)
    pairs = []
    for place, i in enumerate(chosen):
        near = np.flatnonzero(np.abs(means[place + 1 :] - means[place]) < SIMILAR) + place + 1
        close = (np.abs(pictures[near] - pictures[place]) >= SIMILAR).mean(axis=1) < _ELSEWHERE
        for other in near[close].tolist():
            j = chosen[other]
            if looks[i].digest != looks[j].digest and looks[i].shape == looks[j].shape:
                level = np.quantile(np.abs(pictures[other] - pictures[place]), 1 - _ELSEWHERE)
                pairs.append((i, j, float(level)))
    return sorted(pairs, key=lambda pair: pair[2])
