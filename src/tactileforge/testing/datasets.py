"""The checks of data sets. They look at the first recordings of each split."""

from __future__ import annotations

import pickle
import re
from dataclasses import replace
from itertools import islice
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from tactileforge.contracts import ACTIONS, LABELS, Recording
from tactileforge.errors import ConfigError, DataNotFoundError
from tactileforge.plugins import registry
from tactileforge.specs.published import spec
from tactileforge.testing.results import Check, CheckSubject, Skip, Violation, require
from tactileforge.util.licences import check_data_licence

_SPLITS = ("train", "val")
#: Number of recordings of a split that stand for all: a data set may have millions.
_MOST = 1000


def _first(dataset: Any, split: str, most: int = 8) -> list[Recording]:
    return list(islice(dataset.recordings(split), most))


def keys_are_what_it_provides(subject: CheckSubject) -> None:
    """Labels of the recordings and ``provides`` are the same."""
    dataset = subject.build()
    provides = dataset.provides
    require(isinstance(provides, frozenset), f"provides is {provides!r}, not a frozenset")
    require(isinstance(dataset.skipped, list), f"skipped is {dataset.skipped!r}, not a list")
    if hasattr(dataset, "cut"):  # a data set that cuts its own samples may have further keys
        provides &= set(LABELS)
    require(provides <= set(LABELS), f"provides {sorted(provides)}; labels are {LABELS}")
    keys: set[str] = set()
    for split in _SPLITS:
        for recording in _first(dataset, split):
            keys |= _labels(recording)
    if not provides <= keys:  # a label may be rare
        keys = keys.union(*map(_labels, _first(dataset, "train", _MOST)))
    require(keys <= provides, f"recordings carry {sorted(keys - provides)}, not in provides")
    require(provides <= keys, f"no recording seen has {sorted(provides - keys)}, in provides")


def _labels(recording: Recording) -> set[str]:
    return {label for label in LABELS if getattr(recording, label) is not None}


def recordings_are_whole(subject: CheckSubject) -> None:
    """Times, labels and frames agree; the sensor is a known one, and so is the licence."""
    for split in _SPLITS:
        recordings = _first(subject.build(), split)
        require(split != "train" or bool(recordings), "the split 'train' has no recording")
        for recording in recordings:
            try:
                _require_whole(recording)
            except (Violation, ConfigError) as wrong:
                raise Violation(f"recording {recording.key!r}: {wrong}") from wrong


def _require_whole(recording: Recording) -> None:
    spec(recording.sensor)
    check_data_licence("licence", recording.licence)
    count, times = len(recording.frames), recording.times
    require(count > 0, "it has no frame")
    require(times.shape == (count,), f"{count} frames, times of shape {times.shape}")
    require(times.dtype == np.float64, f"times are {times.dtype}, not float64")
    require(bool((np.diff(times) > 0).all()), "times do not strictly increase")
    frame = recording.frames.read([count - 1])  # the last: a video may hold fewer than it states
    want = (1, *recording.frames.shape, 3)
    good = frame.dtype == np.uint8 and frame.shape == want
    require(good, f"a frame is {frame.dtype} {frame.shape}, not uint8 {want}")
    if recording.force is not None:
        good = recording.force.dtype == np.float32 and recording.force.shape == (count, 3)
        require(good, f"force is {recording.force.dtype} {recording.force.shape}")
    if recording.action is not None:
        good = recording.action.dtype == np.int64 and recording.action.shape == (count,)
        require(good, f"action is {recording.action.dtype} {recording.action.shape}")
        inside = (recording.action >= -1) & (recording.action < len(ACTIONS))
        require(bool(inside.all()), f"an action is outside -1..{len(ACTIONS) - 1}")


def same_index_same_sample(subject: CheckSubject) -> None:
    """Read twice, and from a second reader: the same recordings in the same order."""
    dataset = subject.build()
    for split in _SPLITS:
        first = _first(dataset, split)
        for again in (_first(dataset, split), _first(subject.build(), split)):
            keys = [[recording.key for recording in recordings] for recordings in (first, again)]
            require(keys[0] == keys[1], f"{split}: {keys[0]}, then {keys[1]}")
            for recording, other in zip(first, again, strict=True):
                last = [len(recording.frames) - 1]
                same = np.array_equal(recording.frames.read(last), other.frames.read(last))
                require(
                    same, f"{split}: recording {recording.key!r} has other frames the second time"
                )


def recordings_go_to_other_processes(subject: CheckSubject) -> None:
    """Recordings can be pickled and read in other processes, as by the workers of a run."""
    for recording in _first(subject.build(), "train"):
        try:
            there = pickle.loads(pickle.dumps(recording))
        except (pickle.PicklingError, AttributeError, TypeError) as error:
            raise Violation(
                f"recording {recording.key!r} cannot be pickled ({error}); keep paths and arrays "
                "in it, not open files or functions made in place"
            ) from error
        last = [len(recording.frames) - 1]
        same = np.array_equal(there.frames.read(last), recording.frames.read(last))
        require(same, f"recording {recording.key!r} has other frames once pickled")


def splits_are_disjoint(subject: CheckSubject) -> None:
    """No frame of a source is in both splits; keys are unique.

    Parts of one recording (`Recording.part`) may be shared out if their times do not overlap.
    """
    dataset = subject.build()
    train, val = (_first(dataset, split, _MOST) for split in _SPLITS)
    keys = [recording.key for recording in (*train, *val)]
    twice = {key for key in keys if keys.count(key) > 1}
    require(not twice, f"several recordings have the key {sorted(twice)[:3]}")
    spans: dict[str, list[Recording]] = {}
    for recording in train:
        spans.setdefault(_source(recording), []).append(recording)
    for two in val:
        for recording in spans.get(_source(two), []):
            apart = recording.times[-1] < two.times[0] or two.times[-1] < recording.times[0]
            require(
                bool(apart), f"{recording.key!r} and {two.key!r} share frames across the splits"
            )


def _source(recording: Recording) -> str:
    return re.sub(r"(\[\d+:\d+\])+$", "", recording.key)


def missing_data_names_the_folder_and_the_fix(subject: CheckSubject) -> None:
    """An empty folder ``root`` raises a `DataNotFoundError` with the folder and a fix."""
    if "root" not in registry.parameters(subject.plugin):
        raise Skip("it has no option 'root'")
    if subject.instance is not None:
        raise Skip("an instance was given; give the class and its options to check this")
    with TemporaryDirectory() as empty:
        try:
            dataset = replace(subject, options={**subject.options, "root": empty}).build()
        except ConfigError as error:  # root alone is not enough for it
            raise Skip(f"give options to check this: {error}") from error
        try:
            recordings = list(islice(dataset.recordings("train"), 1))
        except DataNotFoundError as error:
            text = str(error)
        else:
            raise Violation(f"an empty folder gives {len(recordings)} recordings, and no error")
    require(empty in text, f"the error does not name the folder: {text}")
    # without the path, which may hold such a word itself
    fix = re.search(r"root|set |give |download|https?://", text.replace(empty, ""))
    require(fix is not None, f"the error does not say what to do: {text}")


def plot_gives_a_figure(subject: CheckSubject) -> None:
    """`plot` returns a matplotlib figure with something drawn on it."""
    from matplotlib import pyplot
    from matplotlib.figure import Figure

    dataset = subject.build()
    if not hasattr(dataset, "plot"):
        raise Skip("it has no plot, which training does without")
    recordings = _first(dataset, "train", 1)
    if not recordings:
        raise Skip("there is no recording to plot")
    figure = dataset.plot(recordings[0])
    require(isinstance(figure, Figure), f"plot gives a {type(figure).__name__}, not a Figure")
    try:
        require(any(axes.has_data() for axes in figure.axes), "the figure is empty")
    finally:
        pyplot.close(figure)


CHECKS: list[Check] = [
    keys_are_what_it_provides,
    recordings_are_whole,
    same_index_same_sample,
    recordings_go_to_other_processes,
    splits_are_disjoint,
    missing_data_names_the_folder_and_the_fix,
    plot_gives_a_figure,
]
