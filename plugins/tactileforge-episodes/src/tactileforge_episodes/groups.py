"""Episodes of a container by its names: groups, or rows of its arrays."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactileforge.reading import FINGERS, VIEWS, says_touch, words_of
from tactileforge_episodes.looks import Arrays, Look
from tactileforge_episodes.names import natural

#: Words of an episode in the names of groups and arrays.
_EPISODE = {
    *("episode", "episodes", "ep", "eps", "demo", "demos", "demonstration", "traj", "trajectory"),
    *("trial", "take", "rollout", "run", "sequence", "seq", "clip", "recording", "rec"),
}
#: Words of arrays that say where episodes are, by what they hold; the first that fits counts.
_HOLDS = {
    "ends": {"ends", "end", "boundaries", "splits", "offsets"},
    "starts": {"starts", "start", "begins", "offsets"},
    "lengths": {"lengths", "length", "lens", "len", "counts"},
    "numbers": {"index", "indices", "idx", "id", "ids", "number", "numbers", "num", "episode"},
}
#: Largest array that says where episodes are, and deepest group that is one.
_MOST, _DEEPEST = 10_000_000, 3
#: Names of the arrays with the names of the episodes of a split.
SPLITS: dict[str, tuple[str, ...]] = {
    "train": ("train",),
    "val": ("valid", "val", "validation", "test"),
}


def find_groups(keys: Sequence[str]) -> tuple[str, str]:
    """Template of the groups of episodes, and the fullest of them; "" for none.

    Example:
        >>> find_groups(["data/demo_0/obs/x", "data/demo_0/actions", "mask/train"])
        ('data/demo_{number#}', 'data/demo_0')
    """
    found: dict[str, dict[str, int]] = {}
    for key in keys:
        parts = key.split("/")
        for depth in range(min(_DEEPEST, len(parts) - 1)):
            fits = re.fullmatch(r"(\D*?)(\d+)", parts[depth])
            words = words_of(fits[1]) if fits else ()
            if fits is None or (words and words[-1] not in _EPISODE):
                continue
            place = words_of("/".join(parts[:depth]))
            if not words and (says_touch(place) or not (FINGERS | VIEWS).isdisjoint(place)):
                continue  # sensors that are counted
            split = depth > 0 and parts[depth - 1] in sum(SPLITS.values(), ())
            above = [*parts[: depth - 1], "{split}"] if split else parts[:depth]
            template = "/".join([*above, fits[1] + "{number#}"])
            counts = found.setdefault(template, {})
            group = "/".join(parts[: depth + 1])
            counts[group] = counts.get(group, 0) + 1
            break
    template = max(found, key=lambda one: sum(found[one].values()), default="")
    if not template or 2 * sum(found[template].values()) < len(keys) or template.count("{") > 2:
        return "", ""
    counts = found[template]
    return template, min(counts, key=lambda group: (-counts[group], natural(group)))


def find_splits(keys: Sequence[str]) -> dict[str, str]:
    """Arrays with names of the episodes of each split, of ``mask/train`` and the like."""
    found: dict[str, str] = {}
    for split, names in SPLITS.items():
        places = [f"{top}/{name}" for name in names for top in ("mask", "masks", "split", "splits")]
        if there := [key for key in places if key in keys]:
            found[split] = there[0]
    return found


def find_ends(file: Arrays, looks: Sequence[Look], rows: int) -> dict[str, Any]:
    """Keys of a map for episodes as rows of all arrays; {} for none.

    Args:
        file: The container.
        looks: Its arrays.
        rows: Rows of touch.

    Raises:
        DataError: An array is damaged.
    """
    for look in looks:
        shape = look.facts.shape
        flat = shape[1:] in ((), (1,)) and 0 < look.facts.rows <= _MOST
        if not shape or not flat or look.facts.dtype.kind not in "iu" or not look.has(_EPISODE):
            continue
        values = file.array(look.key).rows(range(shape[0])).reshape(-1).astype(np.int64)
        for holds, words in _HOLDS.items():
            if look.has(words) and _fits(holds, values, rows):
                return {"ends": look.key} | ({} if holds == "ends" else {"ends_are": holds})
    return {}


def _fits(holds: str, values: NDArray[np.int64], rows: int) -> bool:
    steps = np.diff(values)
    if holds == "ends":
        return bool(values[-1] == rows and (steps > 0).all() and values[0] > 0)
    if holds == "starts":
        return bool(values[0] == 0 and values[-1] < rows and (steps > 0).all())
    if holds == "lengths":
        return bool(values.sum() == rows and (values > 0).all())
    runs = values[np.append(True, steps != 0)]
    return len(values) == rows and len({*runs.tolist()}) == len(runs)
