"""Episodes of a container by its names: groups, or rows of its arrays."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactileforge.reading import (
    DERIVED,
    FINGERS,
    ROBOT,
    SIDE_NAMES,
    VIEWS,
    says_scene,
    says_touch,
    words_of,
)
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
    found: dict[str, dict[str, set[str]]] = {}
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
            group = "/".join(parts[: depth + 1])
            inside = found.setdefault(template, {}).setdefault(group, set())
            inside.add("/".join(parts[depth + 1 :]))
            break
    found = _joined(found)
    template = max(found, key=lambda one: _count(found[one]), default="")
    if not template:
        return _alike(keys)
    groups = found[template]
    if 2 * _count(groups) < len(keys) or template.count("{") > 2:
        return "", ""
    return template, min(groups, key=lambda group: (-len(groups[group]), natural(group)))


def _count(groups: Mapping[str, set[str]]) -> int:
    """Number of arrays of groups."""
    return sum(map(len, groups.values()))


def _joined(found: Mapping[str, dict[str, set[str]]]) -> dict[str, dict[str, set[str]]]:
    """Templates, joined if they differ only in the name of one group above, such as an object's."""
    alike: dict[tuple[str, ...], list[str]] = {}
    for template in found:
        *above, last = template.split("/")
        for place in range(len(above)):
            alike.setdefault((*above[:place], "", *above[place + 1 :], last), []).append(template)
    out = dict(found)
    for parts, templates in alike.items():
        names = [one.split("/")[parts.index("")] for one in templates]
        held = [max(found[one].values(), key=len) for one in templates]
        is_left = all(one in out for one in templates)
        if is_left and held.count(held[0]) == len(held) > 1 and _may_be_episodes(names):
            joint = "/".join(part or _placeholder(names) for part in parts)
            out[joint] = {group: own for one in templates for group, own in out.pop(one).items()}
    return out


def _alike(keys: Sequence[str]) -> tuple[str, str]:
    """Template of groups with the same arrays, touch among them; "" for none."""
    inside: dict[str, set[str]] = {}
    for key in keys:
        group, _, rest = key.partition("/")
        inside.setdefault(group, set()).add(rest)
    names = sorted(inside, key=natural)
    held = inside[names[0]] if names else set()
    if len(names) < 2 or "" in held or any(own != held for own in inside.values()):
        return "", ""
    if not any(says_touch(words_of(rest)) for rest in held) or not _may_be_episodes(names):
        return "", ""
    return _placeholder(names), names[0]


def _may_be_episodes(names: Sequence[str]) -> bool:
    """Whether groups may be recordings or objects: no sensors, sides or parts of a robot."""
    words = {word for name in names for word in words_of(name)}
    parts = FINGERS | VIEWS | SIDE_NAMES | ROBOT | DERIVED
    return parts.isdisjoint(words) and not any(
        says_touch(words_of(name)) or says_scene(words_of(name)) for name in names
    )


def _placeholder(names: Sequence[str]) -> str:
    """Placeholder of groups: of splits, or of objects if their names count nothing."""
    if {name.lower() for name in names} <= {word for words in SPLITS.values() for word in words}:
        return "{split}"
    words = {word for name in names for word in words_of(name)}
    is_counted = any(word.isdecimal() for word in words) or not _EPISODE.isdisjoint(words)
    return "{group}" if is_counted else "{object}"


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
