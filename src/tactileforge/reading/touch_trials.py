"""Trials of the touches of layouts, held out together."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path, PurePosixPath

from tactileforge.reading.found_touches import span_of
from tactileforge.reading.layout import DatasetLayout
from tactileforge.reading.reader import LayoutReader
from tactileforge.reading.touch import LayoutTouch
from tactileforge.reading.trials import trials_of


def join_trials(
    found: Sequence[tuple[LayoutReader, Sequence[LayoutTouch]]],
) -> list[list[tuple[str, str]]]:
    """Layout and name of the trials of the touches of each layout.

    Layouts of one folder share trials, each under the first of them: two sensors of a take may each
    have a layout of their own.
    """
    trials = [
        [(reader.layout.name, trial) for trial in _trials(reader.layout, touches)]
        for reader, touches in found
    ]
    folders: dict[Path, list[tuple[int, int, str]]] = {}
    for of, (reader, touches) in enumerate(found):
        named = zip(touches, _names(reader.layout, touches), strict=True)
        for place, (touch, name) in enumerate(named):
            is_only = trials[of][place][1] == touch.name  # of its layout
            if is_only and reader.layout.hold_out == "trial":
                folders.setdefault(reader.folder, []).append((of, place, name))
    for rows in folders.values():
        joined = trials_of([name for *_, name in rows])
        layouts: dict[str, set[int]] = {}
        for (of, *_), trial in zip(rows, joined, strict=True):
            layouts.setdefault(trial, set()).add(of)
        for (of, place, _), trial in zip(rows, joined, strict=True):
            if len(layouts[trial]) > 1:
                trials[of][place] = found[min(layouts[trial])][0].layout.name, trial
    return trials


def _trials(layout: DatasetLayout, touches: Sequence[LayoutTouch]) -> list[str]:
    """Names of the trials of touches, the held-out units; see `trials.trials_of`."""
    names = _names(layout, touches)
    spans = {}
    for name, touch in zip(names, touches, strict=True):
        if (span := span_of(touch.paths)) is not None:
            spans[name] = span
    trials = trials_of(names, spans)
    alone = Counter(trials)
    # a recording without others keeps its own name, whatever words are in it
    return [
        trial if alone[trial] > 1 else touch.name
        for trial, touch in zip(trials, touches, strict=True)
    ]


def _names(layout: DatasetLayout, touches: Sequence[LayoutTouch]) -> list[str]:
    """Names of touches, for telling trials: paths without the endings of files."""
    names = [touch.folder or touch.name for touch in touches]
    if layout.each != "sequence":
        names = [str(PurePosixPath(name).with_suffix("")) for name in names]
    return names
