"""Checks where data enters a run: all labels, and the frames of a few recordings."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from tactileforge.checks.check import Finding
from tactileforge.checks.codes import CODES
from tactileforge.checks.listing import catalogue
from tactileforge.checks.resting import Resting, odd_pictures
from tactileforge.checks.rules_names import CaptionsOfSides
from tactileforge.checks.run import CHECKED_AT_ENTRY, DECODING, CheckRun, lines_of
from tactileforge.checks.seen import Seen
from tactileforge.contracts import Recording
from tactileforge.data.batches.leaks import find_copies
from tactileforge.data.frames.cut import spread_rows
from tactileforge.sensors.resting_colours import colour_grid, has_colours, known_colours

#: Checks of frames that are no errors, but are run where data enters, too.
_ALSO = ("background_changed", "drifting_force")
#: Copies of recordings that are named.
_NAMED = 4
#: What puts a picture right that a program holds.
_PICTURE_FIXES = {
    "mirrored": "give frames and background without the mirror (picture[:, ::-1], or [::-1])",
    "on_its_side": "turn frames and background upright (numpy.rot90)",
    "colours_swapped": "give both as RGB (picture[..., ::-1] of OpenCV's)",
}


def entry_checks() -> list[str]:
    """Names of the checks of frames, run on a few recordings at the start of a run."""
    return [
        name
        for name, check in catalogue().items()
        if check.needs & DECODING
        and "all frames" not in check.needs
        and "set" not in check.needs
        and (check.level == "error" or name in _ALSO)
    ]


def frame_lines(
    train: Sequence[Recording], val: Sequence[Recording] = (), has_layout: bool = True
) -> list[str]:
    """One line for each check of frames with findings, from a few recordings.

    Args:
        train: Training recordings; `CHECKED_AT_ENTRY` of all are decoded, at 24 frames and a
            stretch of 64.
        val: Held-out recordings.
        has_layout: Whether a layout describes them.
    """
    both = [*((one, "train") for one in train), *((one, "val") for one in val)]
    places = spread_rows(len(both), CHECKED_AT_ENTRY)
    run = CheckRun(entry_checks())
    found: list[Finding] = []
    for place in places:
        found += run.look(*both[place], has_layout)
    return lines_of([*found, *run.end()], len(places))


def copy_lines(train: Sequence[Recording], val: Sequence[Recording]) -> list[str]:
    """Line on copies of one recording in both splits; none without any.

    Args:
        train: Training recordings.
        val: Held-out recordings.
    """
    found = find_copies(train, val)
    if not found:
        return []
    named = ", ".join(f"{ours} and {theirs}" for ours, theirs in found[:_NAMED])
    more = f", and {len(found) - _NAMED} more" if len(found) > _NAMED else ""
    name = "copies_across_splits"
    return [
        f"{CODES[name]} {len(found)} held-out recordings are copies of training ones ({named}"
        f"{more}), so validation says nothing of new data; {catalogue()[name].fix}"
    ]


def caption_lines(recordings: Iterable[Recording], mirrors: Collection[str]) -> list[str]:
    """Line on captions that mirrored clips make wrong; none without any.

    Args:
        recordings: The recordings.
        mirrors: Changes of clips: ``horizontal``, ``vertical``, ``turn``.
    """
    if not mirrors:
        return []
    check = CaptionsOfSides(mirrors)
    for one in recordings:
        check.look(Seen(one))
    return lines_of(check.end(), 0)


def background_lines(still: NDArray[np.uint8], sensor: str) -> list[str]:
    """Lines on a picture without contact that lies on its side, is mirrored, or has other colours.

    Args:
        still: Picture without contact, uint8 (H, W, 3).
        sensor: Name of the type of sensor; one whose colours are unknown has no findings.
    """
    grid, reference = colour_grid(still), known_colours(sensor)
    if reference is None or not has_colours(grid):
        return []
    seen = [Resting("background", sensor, still.shape[:2], still.astype(np.float32))]
    return [
        f"{CODES[odd.reason]} the background looks {odd.words.partition(' (')[0].strip()} for a "
        f"{sensor}; if so, {_PICTURE_FIXES[odd.reason]}"
        for odd in odd_pictures(seen)
        if odd.reason in _PICTURE_FIXES
    ]
