"""Files of a data set, and facts measured on the first of them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from itertools import islice
from pathlib import Path

import numpy as np

from tactileforge.errors import DataError, unknown
from tactileforge_episodes.clock import splits_of
from tactileforge_episodes.forces import read_force
from tactileforge_episodes.groups import SPLITS
from tactileforge_episodes.map_keys import EpisodeMap, SplitKeys
from tactileforge_episodes.names import fill, match, match_end, natural, placeholders
from tactileforge_episodes.places import KINDS, Place, find_places, open_place
from tactileforge_episodes.reader import EpisodeFile
from tactileforge_episodes.statements import Statements
from tactileforge_episodes.values import EpisodeArrays

#: Suffixes that are no part of the name of a file.
_SUFFIXES = (".zarr", *KINDS)
#: Most rows of a file whose forces are averaged.
_ROWS = 100_000


def find_files(
    root: Path, keys: EpisodeMap, reading: Statements, skipped: list[str], notes: list[str]
) -> Iterator[EpisodeFile]:
    """Yields the files of a map below a folder, in order.

    Args:
        root: The folder, or a single file.
        keys: The map.
        reading: What the user says.
        skipped: Gets a line for each archive that cannot be read.
        notes: Gets a line for files that the map does not describe, or that are there twice.
    """
    seen: dict[str, Place] = {}
    others: list[Place] = []
    used: set[Place] = set()

    def bad(line: str) -> None:
        if line not in skipped:
            skipped.append(line)

    for place in find_places(root, bad):
        values = path_values(place, keys)
        if values is None:
            others.append(place)
            continue
        name = _name(root, place)
        if name in seen:
            notes.append(f"{place}: the same name as {seen[name]}, which is read; move one away")
            continue
        seen[name] = place
        beside = _beside(place, keys, values)
        used |= {*beside.values()}
        if not placeholders(keys.within):
            arrays = EpisodeArrays(place, beside, keys.within)
            yield EpisodeFile(arrays, name, keys, values, reading)
            continue
        try:
            yield from _groups(place, beside, name, keys, values, reading, notes)
        except DataError as error:
            bad(str(error))
    left = [place for place in others if place not in used]
    if left and seen:
        more = f" (and {len(left) - 1} more)" if len(left) > 1 else ""
        notes.append(f"{left[0]}: not described by the map, so left out{more}")


def _groups(
    place: Place,
    beside: Mapping[str, Place],
    name: str,
    keys: EpisodeMap,
    values: Mapping[str, str],
    reading: Statements,
    notes: list[str],
) -> Iterator[EpisodeFile]:
    """Groups of a file, one per episode, in natural order.

    Raises:
        DataError: The file is damaged, or has no such group.
    """
    depth = keys.within.count("/") + 1
    listed = open_place(place).keys()
    inner: dict[str, list[str]] = {}
    for one in listed:
        parts = one.split("/")
        if len(parts) > depth:
            inner.setdefault("/".join(parts[:depth]), []).append(one)
    found = dict(match(fill(keys.within, values), inner))
    if not found:
        raise DataError(f"{place}: {unknown('group', keys.within, sorted(inner))}")
    shared = keys.within[: keys.within.index("{")].count("/")
    names = {group: "/".join(group.split("/")[shared:]) for group in sorted(found, key=natural)}
    said = splits_of(place, keys.splits or SplitKeys(), {*listed}, names.values())
    for group, own in names.items():
        for split, words in SPLITS.items():
            if found[group].get("split") in words:
                said.setdefault(own, split)
    if left := [one for one, split in said.items() if not split]:
        notes.append(f"{place}: {len(left)} episodes, such as {left[0]}, are in no split: left out")
    for group, own in names.items():
        arrays = EpisodeArrays(place, beside, group, inner[group])
        its = {**values, **found[group]}
        yield EpisodeFile(arrays, f"{name}/{own}", keys, its, reading, said.get(own))


def path_values(place: Place, keys: EpisodeMap) -> dict[str, str] | None:
    """Placeholders of the path of a file; None for one that a map does not describe."""
    parts = place.unpacked.absolute().parts
    if not keys.files:
        return {"name": Path(parts[-1]).stem}
    found = (match_end(template, parts) for template in keys.files)
    return next((values for values in found if values is not None), None)


def _name(root: Path, place: Place) -> str:
    path = place.unpacked
    base = root.parent if Path(place.path) == root else root
    name = path.relative_to(base).as_posix()
    suffix = next((one for one in _SUFFIXES if name.endswith(one)), "")
    return name.removesuffix(suffix)


def _beside(place: Place, keys: EpisodeMap, values: Mapping[str, str]) -> dict[str, Place]:
    """Further files of an episode, of those present."""
    if place.inner or not keys.beside:
        return {}
    path = Path(place.path)
    template = next(t for t in keys.files if match_end(t, path.absolute().parts) is not None)
    base = path.absolute().parents[template.count("/")]
    found = {word: base / fill(name, values) for word, name in keys.beside.items()}
    return {
        word: Place(str(file), "", KINDS[file.suffix])
        for word, file in found.items()
        if file.is_file() and file.suffix in KINDS
    }


def measure_signs(
    root: Path, keys: EpisodeMap, reading: Statements, count: int, notes: list[str]
) -> Statements:
    """Measures the sign of forces of unpublished direction.

    Args:
        root: The folder.
        keys: The map.
        reading: What the user says.
        count: Number of files that are averaged.
        notes: Gets a line for each force that is turned.
    """
    if not any(touch.force and touch.force.sign[2] == "mean" for touch in keys.touch):
        return reading
    sums: dict[int, float] = {}
    for file in islice(find_files(root, keys, reading, [], []), count):
        try:
            for touch in file.touches:
                about = touch.keys.force
                ref = None if about is None else file.arrays.find(about.array, touch.values)
                if about is None or ref is None or about.sign[2] != "mean":
                    continue
                rows = range(min(file.rows, ref.facts.rows, _ROWS))
                z = read_force(ref, about, rows, touch.pad, keys.limit)[:, 2]
                sums[touch.entry] = sums.get(touch.entry, 0.0) + float(np.nansum(z))
        except DataError:
            continue  # named when it is read
    signs = {entry: -1.0 if total < 0 else 1.0 for entry, total in sums.items()}
    if -1.0 in signs.values():
        notes.append("z of the forces is turned: its mean was negative, and pressing is positive")
    return replace(reading, signs=signs)
