"""Train, validation and test splits, and leakage checks."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import torch
from numpy.typing import NDArray

from tactileforge.data import find_copies
from tactileforge.errors import ConfigError, DataError
from tactileforge_bench.tasks.facts import matches_filter, recording_fact, unknown_values
from tactileforge_bench.tasks.source import TaskSource
from tactileforge_bench.tasks.suite import SplitPlan, Task
from tactileforge_bench.tasks.targets import Target, TargetPart

#: What `Recording.part` adds to a key: first frame, and the one after the last.
_PART = re.compile(r"\[(\d+):(\d+)\]")


class SplitClips(Protocol):
    """A task with its splits; see `fit.resolve.PreparedTask`."""

    @property
    def target(self) -> Target:
        """Target of the prediction."""
        ...

    @property
    def splits(self) -> Sequence[Split]:
        """Clips for training, validation and test, one split for each fold."""
        ...


@dataclass(frozen=True)
class Split:
    """Clips by their use, as places in the clips of a `Target`.

    Attributes:
        train: int64.
        validation: int64.
        test: int64.
    """

    train: NDArray[np.int64]
    validation: NDArray[np.int64]
    test: NDArray[np.int64]

    @property
    def known(self) -> NDArray[np.int64]:
        """Clips for a fit with chosen options: training and validation, ascending."""
        return np.sort(np.concatenate([self.train, self.validation]))

    @property
    def every(self) -> NDArray[np.int64]:
        """All clips of the split."""
        return np.concatenate([self.train, self.validation, self.test])


def build_splits(
    task: Task, source: TaskSource, target: Target, fitted: bool = True
) -> list[Split]:
    """The splits of a task: one, or one for each fold.

    Args:
        task: The task.
        source: Source of its clips.
        target: Target of the prediction.
        fitted: Whether its probe needs training clips. Without them one split tests the clips of
            ``split.test``; with folds, or with neither, it tests all.

    Raises:
        ConfigError: A filter finds nothing, or two uses share a recording.
        DataError: The labels of a part are all of one class.
    """
    plan, of = task.split, source.index[target.clips, 0]
    numbers = [n for n in sorted(set(of.tolist())) if matches_filter(source, n, plan.only)]
    if not numbers:
        raise ConfigError(f"task {task.name}: split.only leaves no recording; change it")
    if not fitted:
        return [_only_test(task, source, target, of, numbers)]
    stratum = _strata(numbers, of, target)
    if plan.folds:
        names = {n: recording_fact(source, n, plan.group) for n in numbers}
        dealt = [name for group in _ordered(names, stratum).values() for name in group]
        if len(dealt) < plan.folds:
            raise ConfigError(f"{plan.folds} folds of {len(dealt)} groups; give split.folds fewer")
        # in turn along the strata: folds differ by one group at most, and nearly so in classes
        fold = {name: place % plan.folds for place, name in enumerate(dealt)}
        tests = [[n for n in numbers if fold[names[n]] == k] for k in range(plan.folds)]
    else:
        tests = [[n for n in numbers if matches_filter(source, n, plan.test)]]
    splits = []
    for test in tests:
        rest = [n for n in numbers if n not in set(test) and matches_filter(source, n, plan.train)]
        # of what is left to train: the test is chosen first, and takes no part in selection
        validation = _validation(plan, source, rest, stratum)
        train = [n for n in rest if n not in set(validation)]
        for name, chosen in (("train", train), ("validation", validation), ("test", test)):
            if not chosen:
                slip = unknown_values(source, getattr(plan, name)) if name == "test" else ""
                why = slip or _nothing_for(name, task, len(numbers), len(rest), len(test))
                raise ConfigError(f"task {task.name}: no recording for {name}: {why}")
        check_leakage(task, source, train, validation, test)
        places = [np.flatnonzero(np.isin(of, chosen)) for chosen in (train, validation, test)]
        splits.append(Split(*places))
    _check_classes(task, target, splits)
    return splits


def copies_across(source: TaskSource, task: SplitClips) -> str:
    """Words on test recordings with the pictures of one that is known; "" without any.

    Args:
        source: Source of the clips.
        task: Splits of a task, and its clips.
    """
    found: dict[str, str] = {}
    for split in task.splits:
        numbers = [
            sorted(set(source.index[task.target.clips[places], 0].tolist()))
            for places in (split.known, split.test)
        ]
        known, test = ([source.recordings[n] for n in of] for of in numbers)
        for ours, theirs in find_copies(known, test):
            if (theirs, ours) not in found.items():
                found[ours] = theirs
    if not found:
        return ""
    first, *_ = found.items()
    return (
        f"TF501 {len(found)} test recordings are copies of ones that are trained on "
        f"({first[0]} and {first[1]}), so the numbers are too good: remove one of each"
    )


def _only_test(
    task: Task, source: TaskSource, target: Target, of: NDArray[np.int64], numbers: Sequence[int]
) -> Split:
    """The split of a probe without training clips."""
    test = [n for n in numbers if matches_filter(source, n, task.split.test)]
    if not test:
        raise ConfigError(_nothing_for("test", task, len(numbers), len(numbers), 0))
    nothing = np.zeros(0, np.int64)
    split = Split(nothing, nothing, np.flatnonzero(np.isin(of, test)))
    _check_classes(task, target, [split], ("test",))
    return split


def _nothing_for(use: str, task: Task, every: int, rest: int, test: int) -> str:
    """Reason of a use without recordings: the counts, and the key to change."""
    plan = task.split
    left = {
        "train": f"split.validation={dict(plan.validation)} takes all {rest} that may train"
        if rest
        else f"split.train={dict(plan.train)} finds none in what the test leaves",
        "validation": f"split.validation={dict(plan.validation)} finds none in the {rest} that may "
        "train",
        "test": f"split.test={dict(plan.test)} finds none",
    }
    return (
        f"of {every} recordings of sides {', '.join(task.sides)} the test has {test}, and "
        f"{left[use]}; change that key"
    )


def group_names(
    source: TaskSource, target: Target, places: NDArray[np.int64], fact_name: str
) -> list[str]:
    """A fact of the recording of each clip, by places in the clips of a target."""
    numbers = source.index[target.clips[places], 0].tolist()
    known = {number: recording_fact(source, number, fact_name) for number in set(numbers)}
    return [known[number] for number in numbers]


def check_leakage(
    task: Task,
    source: TaskSource,
    train: Sequence[int],
    validation: Sequence[int],
    test: Sequence[int],
) -> None:
    """Raises a ConfigError if two splits share frames or an unseen fact: a check for leakage."""
    uses = {"train": train, "validation": validation, "test": test}
    # by frames: two parts of a recording may overlap, though their keys differ
    spans = [
        (*_span(source.recordings[n].key), use) for use, chosen in uses.items() for n in chosen
    ]
    # spans of a recording sorted by start: an overlap is with the one that reaches farthest so far
    spans.sort()
    reach: dict[str, tuple[float, str]] = {}
    for key, start, stop, use in spans:
        end, before = reach.get(key, (0.0, use))
        if start < end and use != before:
            raise ConfigError(
                f"task {task.name}: recording {key!r} is in {before} and in {use}; correct its "
                "split, or remove the recording that is there twice"
            )
        if stop > end:
            reach[key] = stop, use
    for name in task.split.unseen:
        known = {recording_fact(source, n, name) for n in [*train, *validation]}
        if both := sorted(known & {recording_fact(source, n, name) for n in test}):
            raise ConfigError(
                f"task {task.name}: {name} {both[0]!r} is to be unseen, but is in training and in "
                "test; correct its split"
            )


def _span(key: str) -> tuple[str, float, float]:
    """Key of the whole recording, and the range of frames of this part."""
    start, stop = 0, float("inf")
    # parts of parts: each counts its frames from the start of the one before
    for part in _PART.finditer(key):
        start, stop = start + int(part[1]), start + int(part[2])
    return _PART.sub("", key), start, stop


def _strata(numbers: Sequence[int], of: NDArray[np.int64], target: Target) -> dict[int, int]:
    """Stratum of each recording: its class if all clips agree, else -1."""
    names = target.names
    if names is None:
        return dict.fromkeys(numbers, -1)
    strata = {}
    for number in numbers:
        classes = set(names[of == number].tolist())
        strata[number] = classes.pop() if len(classes) == 1 else -1
    return strata


def _ordered(names: Mapping[int, str], stratum: Mapping[int, int]) -> dict[int, list[str]]:
    """Groups by stratum, in an order by the hashes of their names alone."""
    strata: dict[str, set[int]] = {}
    for number, name in names.items():
        strata.setdefault(name, set()).add(stratum[number])
    by_stratum: dict[int, list[str]] = {}
    # by hash: neighbours in name, often of one session, are spread; equal on every machine
    for name in sorted(strata, key=lambda name: hashlib.sha256(name.encode()).digest()):
        only = strata[name].pop() if len(strata[name]) == 1 else -1
        by_stratum.setdefault(only, []).append(name)
    return dict(sorted(by_stratum.items()))


def _validation(
    plan: SplitPlan, source: TaskSource, rest: Sequence[int], stratum: Mapping[int, int]
) -> list[int]:
    chosen = dict(plan.validation)
    share = chosen.pop("share", None)
    if share is None:
        return [n for n in rest if matches_filter(source, n, chosen)]
    group = str(chosen.pop("group", "recording"))
    if chosen:
        raise ConfigError(f"split.validation: share goes only with group, not {sorted(chosen)}")
    names = {n: recording_fact(source, n, group) for n in rest}
    taken: set[str] = set()
    groups = list(_ordered(names, stratum).values())
    for members in groups:
        # rounded half up: round() would go to even numbers
        taken.update(members[: int(share * len(members) + 0.5)])
    # a small share can round to no group in every stratum, but one is needed to select on
    if not taken and groups and len(names) > 1:
        taken.add(max(groups, key=len)[0])
    return [n for n in rest if names[n] in taken]


def unseen_classes(target: Target, splits: Sequence[Split]) -> str:
    """Test clips of classes without training clips, as text; "" if there are none."""
    names: dict[str, None] = {}
    missed = tested = 0
    for part in target.parts.values():
        if part.kind != "classes":
            continue
        for split in splits:
            known, asked = part.truth[np.r_[split.train, split.validation]], part.truth[split.test]
            tested += asked.numel()
            for column, seen in zip(asked.T.long(), known.T.long(), strict=True):
                strange = column[~torch.isin(column, seen)].tolist()
                missed += len(strange)
                names |= dict.fromkeys(part.names[place] for place in sorted(set(strange)))
    if not missed:
        return ""
    listed = ", ".join([*list(names)[:8], *(["..."] if len(names) > 8 else [])])
    return f"{missed} of {tested} test labels are classes that training never saw: {listed}"


def _counts(part: TargetPart) -> str:
    """Number of clips of each class, the rarest first."""
    rows, counts = np.unique(part.truth.numpy(), return_counts=True)
    found = sorted(zip(counts.tolist(), rows.tolist(), strict=True))
    listed = [f"{count} {part.names[int(row)]!r}" for count, row in found[:8]]
    return ", ".join([*listed, *(["..."] if len(found) > 8 else [])])


def _check_classes(
    task: Task, target: Target, splits: Sequence[Split], uses: Sequence[str] = ("train", "test")
) -> None:
    for name, part in target.parts.items():
        if part.kind != "classes":
            continue
        for use in uses:
            rows = [getattr(split, use) for split in splits]
            # all folds are measured together; but each trains a probe of its own
            if use == "test":
                rows = [np.concatenate(rows)]
            for places in rows:
                for column in part.truth[places].T:
                    if len(column.unique()) < 2:
                        raise DataError(
                            f"task {task.name}: all {len(column)} clips for {use} are "
                            f"{name} {part.names[int(column[0])]!r}, of {_counts(part)}: each part "
                            "of the split needs two classes or more; give more of the rare ones"
                        )
