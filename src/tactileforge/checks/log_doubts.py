"""Warnings about the data before the first training step."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from collections.abc import Set as AbstractSet
from itertools import chain

import numpy as np

from tactileforge.checks.doors import caption_lines, copy_lines, frame_lines
from tactileforge.checks.doubts import Doubts
from tactileforge.contracts import Dataset, Recording
from tactileforge.data.batches.datamodule import TouchData
from tactileforge.data.frames.cut import frame_period, is_slow

log = logging.getLogger(__name__)


def log_doubts(
    dataset: Dataset,
    train: Sequence[Recording],
    val: Sequence[Recording],
    spacing: float,
    frames: int,
) -> tuple[Doubts, list[str]]:
    """Log doubts about labels and times, and frames too far apart for the clips.

    Args:
        dataset: Data set, for the notes of its reader.
        train: Training recordings, or a sample of them.
        val: Held-out recordings.
        spacing: Seconds between the frames of a clip.
        frames: Frames of a clip.

    Returns:
        The doubts, of which `Doubts.of_all` has those about the labels of an objective, and the
        lines of the checks that found something.
    """
    doubts = Doubts()
    for recording in chain(train, val):
        doubts.add(recording)
    has_layout = hasattr(type(dataset), "layouts")
    found = [*doubts.of_each(), *frame_lines(train, val, has_layout)]
    for line in (*getattr(dataset, "notes", ()), *found):
        log.warning("data: %s", line)
    span = (frames - 1) * spacing
    # stills are shown as clips on purpose
    short = [one for one in train if len(one.times) > 1 and one.times[-1] - one.times[0] < span / 2]
    if short:
        first = short[0]
        log.warning(
            "data: %d of %d recordings last less than half a clip (%.3g s), so their frames are "
            "repeated (%s lasts %.3g s): is their rate (fps:) too high?",
            *(len(short), len(train), span, first.key, first.times[-1] - first.times[0]),
        )
    periods = [frame_period(one.times) for one in train if len(one.times) > 1]
    slow = [period for period in periods if is_slow(period, spacing, frames)]
    if slow:
        usual = float(np.median(slow))
        # a few slow recordings are a property of many public sets; most of them are a mistake
        level = logging.WARNING if 2 * len(slow) >= len(periods) else logging.INFO
        log.log(
            level,
            "data: frames come every %.3g s in %d of %d recordings, and the recipe's clips have "
            "them %.3g s apart: such clips are %.1f times as long. Record at %.3g frames a second "
            "or more, or give batch.spacing=%.3g",
            *(usual, len(slow), len(periods), spacing),
            *(usual / spacing, 1 / spacing, usual),
        )
    return doubts, found


class Examination:
    """Doubts about a set, logged before it is trained on; see `TouchData.examiner`.

    Attributes:
        found: A line for each check that found something, ``CODE what; fix``.
    """

    def __init__(self) -> None:
        self._doubts = Doubts()
        self.found: list[str] = []

    def look(self, data: TouchData, train: Sequence[Recording], val: Sequence[Recording]) -> None:
        """Log doubts about recordings."""
        self._doubts, self.found = log_doubts(data.dataset, train, val, data.spacing, data.frames)
        mirrors = () if data.augment is None else data.augment.moved_sides
        lines = [*copy_lines(train, val), *caption_lines([*train, *val], mirrors)]
        for line in lines:
            log.warning("data: %s", line)
        self.found += lines

    def of_labels(self, labels: AbstractSet[str]) -> None:
        """Log doubts about the set as a whole, for learned labels."""
        lines = self._doubts.of_all(labels)
        for line in lines:
            log.warning(line)
        self.found += lines
