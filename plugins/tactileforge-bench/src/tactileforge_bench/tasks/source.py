"""Clips of a task: recordings of a data set, and their frame indices."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactileforge.contracts import Dataset, Recording
from tactileforge.data import Clips
from tactileforge.errors import DataError, check_names
from tactileforge.plugins import registry
from tactileforge_bench.tasks.suite import ClipSpec

#: Recordings that an error names.
_NAMED = 5
#: Height and width of a clip that is never decoded.
_SMALL = (8, 8)


class TaskSource:
    """Recordings with their sides of the data set, and an index of clips shared by all models.

    Args:
        recordings: Recordings to cut.
        sides: Side of each in its data set.
        clip: Rule for the ends of clips.

    Attributes:
        index: int64 (n, 2), recording and last frame of each clip.
        first: int64 (n,), first frame of each, ``clip.span`` seconds before.

    Raises:
        DataError: There is nothing to cut.
    """

    def __init__(self, recordings: list[Recording], sides: list[str], clip: ClipSpec) -> None:
        self.recordings, self.sides = recordings, sides
        if clip.parts > 1:
            self.recordings, self.sides = [], []
            for recording, side in zip(recordings, sides, strict=True):
                edges = np.linspace(0, len(recording.times), clip.parts + 1).round().astype(int)
                # a recording of fewer frames than parts has fewer parts
                cut = [recording.part(a, b) for a, b in pairwise(edges.tolist()) if b > a]
                self.recordings += cut
                self.sides += [side] * len(cut)
        self.clip = clip
        # two frames: first and last of each clip; models cut their own between them
        clips = Clips(self.recordings, 2, clip.span, clip.hop, _SMALL)
        if clip.ends:
            clips.index = _fixed(self.recordings, clip.ends)
        self.index: NDArray[np.int64] = clips.index.astype(np.int64)
        self.first = np.array([clips.rows(i)[0] for i in range(len(clips))], np.int64)

    def __len__(self) -> int:
        return len(self.index)

    @property
    def fingerprint(self) -> str:
        """Hash of the clips: names, indices, times, one image of each recording, its background.

        Raises:
            DataError: Recordings cannot be read; names the first of them.
        """
        digest, broken = self._read_once
        refuse_broken(broken)
        return digest

    @property
    def broken(self) -> list[str]:
        """A line for each recording with an unreadable middle image or background."""
        return self._read_once[1]

    @cached_property
    def _read_once(self) -> tuple[str, list[str]]:
        digest = hashlib.sha256(np.ascontiguousarray(self.index).tobytes())
        broken = []
        for recording in self.recordings:
            digest.update(f"{recording.key} {recording.sensor} {recording.frames.shape}".encode())
            try:
                # one picture in the middle: all of them would be as long to read as the bench
                digest.update(recording.frames.read([len(recording.frames) // 2]).tobytes())
                still = recording.background()
            except (DataError, OSError) as error:  # all are named together, not one a run
                broken.append(f"{recording.key}: {error}")
                continue
            digest.update(recording.times.tobytes())
            if still is not None:
                digest.update(still.tobytes())
        return digest.hexdigest(), broken


def refuse_broken(lines: Sequence[str]) -> None:
    """Raises a DataError with the unreadable recordings, if there are any."""
    if lines:
        more = len(lines) - _NAMED
        # an absent recording would make numbers of two benches differ
        raise DataError(
            f"{len(lines)} recordings cannot be read, and the benchmark skips none; mend or remove "
            f"them: {'; '.join(lines[:_NAMED])}{f'; and {more} more' if more > 0 else ''}"
        )


def open_source(data: Mapping[str, Any], sides: tuple[str, ...], clip: ClipSpec) -> TaskSource:
    """Opens the data of a task.

    Args:
        data: See `suite.Task`.
        sides: Sides of the data set to read.
        clip: Rule for cutting clips.

    Raises:
        DataNotFoundError: Data is missing; says what to download.
        DataError: Recordings cannot be opened; or nothing can be cut.
        ConfigError: The node does not fit.
    """
    dataset: Dataset = registry.build("datasets", _node(data), "data")
    recordings: list[Recording] = []
    of: list[str] = []
    for side in sides:
        opened = list(dataset.recordings(side))
        recordings += opened
        of += [side] * len(opened)
    if dataset.skipped:
        others = TaskSource(recordings, of, clip).broken if recordings else []
        refuse_broken([*dataset.skipped, *others])
    if not recordings:
        raise DataError(f"data {data.get('name') or data.get('preset')}: no recording in {sides}")
    return TaskSource(recordings, of, clip)


def _node(data: Mapping[str, Any]) -> dict[str, Any]:
    """The plugin's configuration; a preset keeps only the requested layouts."""
    node = dict(data)
    preset = node.pop("preset", None)
    if preset is None:
        return node
    from tactileforge.cli import option

    layouts = node.pop("layouts", None)
    words = [f"data.{key}={value}" for key, value in node.items()]
    options = option("data", [f"data={preset}", *words])
    if layouts is not None:
        check_names(f"layout of {preset}", layouts, options["layouts"])
        options["layouts"] = {name: options["layouts"][name] for name in layouts}
    return options


def _fixed(recordings: list[Recording], ends: list[Any]) -> NDArray[np.int32]:
    rows = []
    for number, recording in enumerate(recordings):
        count = len(recording.times)
        places = [
            # a share of the recording, or a frame, counted from its end where negative
            round(end * (count - 1)) if isinstance(end, float) else end + count * (end < 0)
            for end in ends
        ]
        rows += [(number, place) for place in dict.fromkeys(places) if 0 <= place < count]
    if not rows:
        raise DataError(f"no recording is long enough for clips that end at {ends}")
    return np.array(rows, np.int32)
