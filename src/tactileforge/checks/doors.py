"""Checks where data enters a run: all labels, and the frames of a few recordings."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence

from tactileforge.checks.check import Finding
from tactileforge.checks.codes import CODES
from tactileforge.checks.listing import catalogue
from tactileforge.checks.rules_names import CaptionsOfSides
from tactileforge.checks.run import CHECKED_AT_ENTRY, DECODING, CheckRun, lines_of
from tactileforge.checks.seen import Seen
from tactileforge.contracts import Recording
from tactileforge.data.batches.leaks import find_copies
from tactileforge.data.frames.cut import spread_rows

#: Checks of frames that are no errors, but are run where data enters, too.
_ALSO = ("background_changed",)
#: Copies of recordings that are named.
_NAMED = 4


def entry_checks() -> list[str]:
    """Names of the checks of frames that are run on a few recordings where data enters a run."""
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
