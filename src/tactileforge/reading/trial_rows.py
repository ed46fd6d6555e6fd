"""Rows of one table for all recordings, each with the name or number of its recording."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import PurePosixPath

from tactileforge.reading.label_rows import ends_of

_NUMBERED = re.compile(r".*?(\d+)")


def recordings_of(cells: Iterable[str], names: Sequence[str]) -> Mapping[str, str]:
    """The recording that each cell names; cells that name none, or several, are left out.

    A cell is the path of a recording, the end of it or its name, with or without the ending; or,
    where all cells are whole numbers, the number at the end of its name.

    Args:
        cells: Cells of a column.
        names: Paths of the recordings.

    Example:
        >>> recordings_of(["mug", "bolt"], ["left/mug", "left/bolt.mp4"])
        {'mug': 'left/mug', 'bolt': 'left/bolt.mp4'}
        >>> recordings_of(["3", "10"], ["trial_003", "trial_010"])
        {'3': 'trial_003', '10': 'trial_010'}
    """
    written = [*dict.fromkeys(cells)]
    found: dict[str, str] = {}
    for name in dict.fromkeys(names):
        bare = str(PurePosixPath(name).with_suffix("")) if name != "." else name
        for spelling in {name, bare, *ends_of(name), *ends_of(bare)}:
            found[spelling] = "" if found.get(spelling, name) != name else name
    told = {
        cell: found[text]
        for cell in written
        if found.get(text := cell.replace("\\", "/").removeprefix("./").rstrip("/"))
    }
    if told or not all(map(str.isdecimal, written)):
        return told
    numbers: dict[int, str] = {}
    for name in dict.fromkeys(names):
        if match := _NUMBERED.fullmatch(PurePosixPath(name).stem):
            number = int(match[1])
            numbers[number] = "" if number in numbers else name
    return {cell: numbers[int(cell)] for cell in written if numbers.get(int(cell))}
