"""Resolves a task to its data and its probe."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from inspect import signature
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactileforge.errors import ConfigError, check_names
from tactileforge_bench.fit.probes import probe_class
from tactileforge_bench.fit.probes.base import Probe, ProbeTraining
from tactileforge_bench.results import results
from tactileforge_bench.tasks import metrics, splits, targets
from tactileforge_bench.tasks.source import TaskSource
from tactileforge_bench.tasks.splits import Split
from tactileforge_bench.tasks.suite import Task
from tactileforge_bench.tasks.targets import Target


@dataclass(frozen=True)
class PreparedTask:
    """A task with its opened data.

    Attributes:
        task: The task.
        source: Source of its clips.
        target: Target of the prediction.
        splits: Clips for training, validation and test, one split for each fold.
    """

    task: Task
    source: TaskSource
    target: Target
    splits: Sequence[Split]

    @property
    def sensors(self) -> list[str]:
        """Names of the sensors of its clips."""
        numbers = np.unique(self.source.index[self.clips, 0])
        return sorted({self.source.recordings[n].sensor for n in numbers})

    @property
    def clips(self) -> NDArray[np.int64]:
        """Clips of the source used by any split: int64, ascending."""
        used: NDArray[np.int64] = np.unique(np.concatenate([one.every for one in self.splits]))
        return self.target.clips[used]

    @property
    def test_units(self) -> list[str]:
        """Bootstrap unit of each test clip, in their order."""
        plan = self.task.split
        unit = plan.unit or plan.group
        return splits.group_names(self.source, self.target, self._test, unit)

    @property
    def test_clips(self) -> list[str]:
        """Recording and last frame of each test clip, in their order; of one image its key."""
        rows = self.source.index[self.target.clips[self._test]].tolist()
        recordings = self.source.recordings
        return [
            recordings[number].key + (f"[{last}]" if len(recordings[number].times) > 1 else "")
            for number, last in rows
        ]

    def test_picture(self, place: int) -> NDArray[np.uint8]:
        """Last frame of a test clip, uint8 (H, W, 3), by its place among them."""
        number, last = self.source.index[self.target.clips[self._test[place]]].tolist()
        return np.asarray(self.source.recordings[number].frames.read([last])[0], np.uint8)

    @property
    def _test(self) -> NDArray[np.int64]:
        return np.concatenate([split.test for split in self.splits])


def prepare_task(task: Task, source: TaskSource, fitted: bool = True) -> PreparedTask:
    """Target and splits of a task; what does not fit is refused before features take their time.

    Args:
        task: The task.
        source: Source of its clips.
        fitted: Whether its probe needs training clips.

    Raises:
        ConfigError: A metric that measures something else, flips of what cannot be mirrored, or a
            split that does not fit the data.
        DataError: No clip has the label, or all are of one class.
    """
    target = targets.build_target(task, source)
    for metric in task.metrics:
        try:
            metrics.part_of(metric, target.parts)
        except ConfigError as error:
            raise ConfigError(f"tasks.{task.name}.metrics: {error}") from error
    # asked once, for its error: a target that cannot be mirrored is found before features
    if task.flips:
        for part in target.parts.values():
            part.flipped(True, True)
    all_splits = splits.build_splits(task, source, target, fitted)
    prepared = PreparedTask(task, source, target, all_splits)
    _ = prepared.test_units  # a fact that intervals are drawn by
    return prepared


@dataclass(frozen=True, kw_only=True)
class ProbeChoice:
    """The probe of a task: its class, its options and its training.

    Attributes:
        name: Name of the probe.
        kind: The class.
        options: Arguments of its constructor.
        training: Training options.
        finetune: Learning rate of the encoder where that is trained too; 0 leaves it frozen.
    """

    name: str
    kind: type[Probe]
    options: dict[str, Any]
    training: ProbeTraining
    finetune: float = 0.0

    def build(self, width: int, target: Target) -> Probe:
        """A new probe."""
        return self.kind(width, target.parts, **self.options)


def choose_probe(task: Task, overrides: Mapping[str, Any]) -> ProbeChoice:
    """The probe of a task, with the overrides of all tasks.

    Raises:
        ConfigError: An unknown probe or option.
    """
    # null among the options of all tasks: as the task has it
    node = {**task.probe, **{key: value for key, value in overrides.items() if value is not None}}
    name = str(node.pop("name"))
    kind = probe_class(name)
    rate = float(node.pop("finetune", 0.0))
    if rate and not kind.trained:
        raise ConfigError(
            f"task {task.name}: probe {name} is not trained by gradients, so the encoder cannot be "
            "trained with it: give probe.name=linear_adamw or attentive, or leave finetune out"
        )
    known = {field.name for field in fields(ProbeTraining)}
    parameters = set(signature(kind).parameters) - {"width", "parts"}
    names = {*known, *parameters, "name", "finetune"}
    check_names(f"option of the probe of task {task.name}", node, names)
    values = {key: value for key, value in node.items() if key in known}
    if "lr" in values:
        rates = values["lr"] if isinstance(values["lr"], list) else [values["lr"]]
        values["lr"] = tuple(map(float, rates))
    if "betas" in values:
        values["betas"] = tuple(values["betas"])
    training = replace(kind.published, **values)
    options = {key: value for key, value in node.items() if key in parameters}
    return ProbeChoice(name=name, kind=kind, options=options, training=training, finetune=rate)


def result_task(task: Task, choice: ProbeChoice, selection: str) -> results.ResultTask:
    """A task as a row of the results."""
    kinds = {name: metrics.metric_kind(name) for name in task.metrics}
    return results.ResultTask(
        name=task.name,
        title=task.title,
        probe=choice.name + (", encoder trained too" if choice.finetune else ""),
        data=task.about or str(task.data.get("name") or task.data.get("preset")),
        split=describe_split(task, choice.kind.fitted),
        metrics=[
            results.ResultMetric(name=name, unit=kind.unit, better=kind.better)
            for name, kind in kinds.items()
        ],
        main=task.metrics[0],
        selection=selection,
        counted=task.counted,
    )


def describe_split(task: Task, fitted: bool = True) -> str:
    """The split of a task, in words; without training clips, its test side alone."""
    plan = task.split
    if not fitted:
        return f"test: {_words({**plan.only, **plan.test}) or 'all clips'}; nothing is fitted"
    validation = dict(plan.validation)
    share = validation.pop("share", None)
    text = f"{plan.folds} folds by {plan.group}" if plan.folds else f"test: {_words(plan.test)}"
    if plan.train:
        text += f"; training: {_words(plan.train)}"
    if share is None:
        text += f"; validation: {_words(validation)}"
    else:
        text += f"; validation: {share:.0%} of training by {validation.get('group', 'recording')}"
    return text + (f"; unseen in test: {', '.join(plan.unseen)}" if plan.unseen else "")


def _words(chosen: Mapping[str, Any]) -> str:
    return ", ".join(
        f"{name} {' or '.join(map(str, value)) if isinstance(value, list) else value}"
        for name, value in chosen.items()
    )
