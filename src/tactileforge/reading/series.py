"""Series of images in one folder, such as those of two sensors: left_0000.png, right_0000.png."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from itertools import combinations, pairwise, takewhile
from pathlib import Path
from typing import Any, TypeAlias

from tactileforge.reading.sides import SIDE_WORDS

_TOKEN = re.compile(r"\d+|[^\W\d_]+")
#: Words before the number of a sensor or camera, and before that of a take.
_DEVICE = re.compile(
    r"cam|camera|sensor|finger|gel\w*|digit|d|sn|serial|id|tac\w*|device|ch|channel|port|gripper"
)
_TAKE = re.compile(r"trial|take|episode|ep|run|rep|repeat|repetition|demo|seq|sequence|traj\w*")
#: Largest number of series by words, or of devices.
_MOST = 16
#: Share of the images of the smaller series whose numbers another one has too, or that follow an
#: image of another one.
_SHARED = 0.5

#: Places of the images of each series.
Groups: TypeAlias = dict[str, list[int]]


def series_of(paths: Sequence[Path]) -> dict[str, list[Path]]:
    """The images of each series of a folder, by name; a folder of one series has the name "".

    Series differ by a word or the number of a device in their names, and count their images alike
    (``left_0000``, ``right_0000``), or take turns (``left_17630000001``, ``right_17630000002``).

    Example:
        >>> names = ("left_0.png", "left_1.png", "right_0.png", "right_1.png")
        >>> list(series_of([Path(name) for name in names]))
        ['left', 'right']
    """
    stems = [path.stem.lower() for path in paths]
    names = dict(enumerate(map(_TOKEN.findall, stems)))
    kinds: dict[tuple[bool, ...], dict[int, list[str]]] = {}
    for at, tokens in names.items():
        kinds.setdefault(tuple(map(str.isdecimal, tokens)), {})[at] = tokens
    most = max(kinds.values(), key=len, default={})
    found = _by_place(most)
    if found:
        for at in names.keys() - most.keys():  # a background, a calibration
            found.setdefault(stems[at], []).append(at)
    else:
        found = _by_words(names) if len(kinds) > 1 else None
    if not found:
        return {"": list(paths)}
    return {name: [paths[at] for at in group] for name, group in found.items()}


def names_of(paths: Sequence[Path]) -> str:
    """A pattern of the names of images: their common parts, and ``*`` for their counter.

    Example:
        >>> names_of([Path("left_0008.png"), Path("left_0009.png")])
        'left_*.png'
    """
    names = [path.name for path in paths]
    start = common_start(names).rstrip("0123456789")
    end = common_start([name[len(start) :][::-1] for name in names])[::-1].lstrip("0123456789")
    return f"{start}*{end}" if len(names) > 1 else names[0]


def common_start(names: Sequence[str]) -> str:
    """The common beginning of all names."""
    first, last = min(names), max(names)
    same = takewhile(lambda pair: pair[0] == pair[1], zip(first, last, strict=False))
    return "".join(letter for letter, _ in same)


def _by_place(names: Mapping[int, Sequence[str]]) -> Groups | None:
    """Series by one or two places in the names; None without."""
    columns: list[tuple[str, ...]] = list(zip(*names.values(), strict=True))
    values = [set(column) for column in columns]
    numbers = [place for place, column in enumerate(columns) if column[0].isdecimal()]
    # the counter has most values, the last of equals; only takes may be more than their images
    for counter in sorted(numbers, key=lambda place: (-len(values[place]), -place)):
        for places in _places(values, counter):
            groups: Groups = {}
            for at, tokens in names.items():
                groups.setdefault("_".join(_word(tokens, one) for one in places), []).append(at)
            counts = {at: int(tokens[counter]) for at, tokens in names.items()}
            by_device = all(
                one in numbers or all(map(SIDE_WORDS.fullmatch, values[one])) for one in places
            )
            if _are_series(groups, counts, by_device):
                return groups
    return None


def _places(values: Sequence[set[str]], counter: int) -> Iterator[tuple[int, ...]]:
    """Places in names for the words of series: one, or else two."""
    able = []
    for place, own in enumerate(values):
        before = values[place - 1] if place else set()
        if place == counter or len(own) < 2:
            continue
        if not next(iter(own)).isdecimal():
            is_able = len(own) <= _MOST
        elif all(map(_DEVICE.fullmatch, before)):
            is_able = place > 0 and len(own) <= min(_MOST, len(values[counter]))
        else:
            is_able = place > 0 and all(map(_TAKE.fullmatch, before))
        if is_able:
            able.append(place)
    yield from ((place,) for place in able)
    yield from combinations(able, 2)


def _word(tokens: Sequence[str], place: int) -> str:
    return tokens[place - 1] + tokens[place] if tokens[place].isdecimal() else tokens[place]


def _by_words(names: Mapping[int, Sequence[str]]) -> Groups | None:
    """Series of names of different parts: ``0001``, ``0001_depth``; None without."""
    groups: Groups = {}
    for at, tokens in names.items():
        words = "_".join(token for token in tokens if not token.isdecimal())
        groups.setdefault(words or "images", []).append(at)
    counts = {at: tuple(filter(str.isdecimal, tokens)) for at, tokens in names.items()}
    return groups if _are_series(groups, counts, False) else None


def _are_series(groups: Groups, counts: Mapping[int, Any], by_device: bool) -> bool:
    """Whether groups count alike, or take turns on a common counter."""
    numbers = sorted(({counts[at] for at in group} for group in groups.values()), key=len)
    if len(groups) < 2 or sum(map(len, numbers)) < len(counts):  # a number is twice in a group
        return False
    fewest = len(numbers[-2])
    if len(numbers[-2] & numbers[-1]) >= max(2, _SHARED * fewest):
        return True
    if not by_device:
        return False
    group_of = {at: name for name, group in groups.items() for at in group}
    order = sorted(group_of, key=counts.__getitem__)
    turns = sum(group_of[before] != group_of[after] for before, after in pairwise(order))
    return turns >= max(3, 2 * _SHARED * fewest)
