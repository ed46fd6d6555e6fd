"""Rows of one table for all recordings, each with the name or number of its recording."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import PurePosixPath

from tactileforge.reading.series import SIDES
from tactileforge.reading.written_names import by_ends

_NUMBERED = re.compile(r".*?(\d+)")


def recordings_of(cells: Iterable[str], names: Sequence[str]) -> Mapping[str, Sequence[str]]:
    """Recordings by the cells of a column; unknown and ambiguous cells are left out.

    A cell is the path of a recording, the end of it or its name, with or without the ending, or
    that of a folder with one recording, or with those of several sensors (``left``, ``right``);
    or, where all cells are whole numbers, the number at the end of such a name.

    Args:
        cells: Cells of a column.
        names: Paths of the recordings.

    Example:
        >>> recordings_of(["mug", "bolt"], ["left/mug", "left/bolt.mp4"])
        {'mug': ['left/mug'], 'bolt': ['left/bolt.mp4']}
        >>> recordings_of(["3", "10"], ["trial_003", "trial_010"])
        {'3': ['trial_003'], '10': ['trial_010']}
        >>> recordings_of(["t0"], ["t0/left.mp4", "t0/right.mp4", "t1/left.mp4"])
        {'t0': ['t0/left.mp4', 't0/right.mp4']}
    """
    written = [*dict.fromkeys(cells)]
    titles = {name: [name] for name in names}, _folders(names)
    bare = ((str(PurePosixPath(name).with_suffix("")), [name]) for name in names if name != ".")
    named = by_ends([*titles[0].items(), *bare]), by_ends(titles[1].items())
    told = {
        cell: found
        for cell in written
        if (text := cell.replace("\\", "/").removeprefix("./").rstrip("/"))
        and (found := named[0].get(text) or named[1].get(text))
    }
    if told or not all(map(str.isdecimal, written)):
        return told
    for one in titles:
        numbers: dict[int, list[str]] = {}
        for title, members in one.items():
            if match := _NUMBERED.fullmatch(PurePosixPath(title).stem):
                number = int(match[1])
                numbers[number] = [] if number in numbers else members
        if told := {cell: numbers[int(cell)] for cell in written if numbers.get(int(cell))}:
            return told
    return {}


def _folders(names: Iterable[str]) -> dict[str, list[str]]:
    """The recordings of each folder with one, or with those of several sensors."""
    found: dict[str, list[str]] = {}
    for name in dict.fromkeys(names):
        for folder in PurePosixPath(name).parents:
            found.setdefault(str(folder), []).append(name)
    return {
        folder: inside
        for folder, inside in found.items()
        if folder != "."
        and (
            len(inside) == 1 or all(SIDES.fullmatch(PurePosixPath(x).stem.lower()) for x in inside)
        )
    }
