"""Runs a benchmark, tasks by models, cell by cell; reports what cannot be run and goes on."""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactileforge.checks import Doubts, frame_lines
from tactileforge.errors import ConfigError, DataError, PluginError, TactileForgeError
from tactileforge.plugins import Bar
from tactileforge_bench.fit import class_heads, evaluate
from tactileforge_bench.fit.evaluate import SourceFeatures
from tactileforge_bench.fit.features import FLIPS, PLAIN, FeatureStore, extract_features
from tactileforge_bench.fit.frozen_encoder import FrozenEncoder
from tactileforge_bench.fit.models import ModelEntry
from tactileforge_bench.fit.resolve import (
    PreparedTask,
    ProbeChoice,
    choose_probe,
    prepare_task,
)
from tactileforge_bench.fit.training import TrainedProbe
from tactileforge_bench.results import results
from tactileforge_bench.results.write import Writer
from tactileforge_bench.tasks import metrics, splits
from tactileforge_bench.tasks.source import TaskSource, open_source
from tactileforge_bench.tasks.suite import Task


@dataclass(frozen=True, kw_only=True)
class BenchOptions:
    """Options of a benchmark.

    Attributes:
        seeds: Probes of each cell; a model that was trained several times takes turns.
        selection: ``validation``, or ``test`` to choose the best epoch as some papers do.
        probe: Options of all probes that replace those of the tasks; None leaves them.
    """

    seeds: int = 3
    selection: str = "validation"
    probe: Mapping[str, Any]

    def __post_init__(self) -> None:
        if self.selection not in ("validation", "test"):
            raise ConfigError(f"selection={self.selection}: give validation or test")
        if self.seeds < 1:
            raise ConfigError(f"seeds={self.seeds}: give 1 or more")


def source_doubts(source: TaskSource) -> list[str]:
    """Lines of the first checks of a training: all labels, frames of eight recordings.

    Args:
        source: Recordings of one or more tasks.
    """
    doubts = Doubts()
    for recording in source.recordings:
        doubts.add(recording)
    return [*doubts.of_each(), *frame_lines(source.recordings, has_layout=False)]


class Bench:
    """Runs tasks on models, one model after another.

    Args:
        tasks: Tasks to measure.
        store: Location of the features.
        writer: Writer of the results.
        options: Options of the run.
    """

    def __init__(
        self, tasks: Sequence[Task], store: FeatureStore, writer: Writer, options: BenchOptions
    ) -> None:
        self.store = store
        self.writer = writer
        self.options = options
        self.choices = {task.name: choose_probe(task, options.probe) for task in tasks}
        self.prepared: list[PreparedTask] = []
        sources: dict[str, TaskSource | TactileForgeError] = {}
        examined: set[int] = set()
        for task in tasks:
            for metric in task.metrics:
                # an unknown metric is an error before data is opened
                metrics.metric_kind(metric)
            source = _source(task, sources)
            try:
                if isinstance(source, TactileForgeError):
                    raise source
                fitted = self.choices[task.name].kind.fitted
                prepared = prepare_task(task, source, fitted)
            except (
                DataError,
                PluginError,
            ) as error:  # data, or the package that reads it, is absent
                reason, fix = _split(error)
                # what a run calls data.root is, on this command line, the task's
                reason = re.sub(r"\bdata\.(?=root|layouts)", f"tasks.{task.name}.data.", reason)
                reason = reason.replace("tasks.classes.data.root", "classes.root")
                writer.not_run(reason, task=task.name, fix=fix)
                continue
            self.prepared.append(prepared)
            strange = splits.unseen_classes(prepared.target, prepared.splits) if fitted else ""
            if strange:
                writer.note(task.name, strange)
            if fitted and (copied := splits.copies_across(prepared.source, prepared)):
                writer.note(task.name, copied)
            if id(source) not in examined:  # told at the first task of its recordings
                examined.add(id(source))
                for line in source_doubts(source):
                    writer.note(task.name, line)

    def run(self, entry: ModelEntry) -> None:
        """Measures all tasks on a model."""
        try:
            subjects = [open_one() for open_one in entry.open[: self.options.seeds]]
        except TactileForgeError as error:
            self.writer.model(
                results.ResultModel(name=entry.name, title=entry.title, group=entry.group)
            )
            reason, fix = _split(error)
            self.writer.not_run(reason, model=entry.name, fix=fix)
            return
        self.writer.model(_model(entry, subjects))
        groups: dict[tuple[int, str], list[PreparedTask]] = {}
        for prepared in self.prepared:
            if self._knows(prepared, entry, subjects):
                # one extraction for all tasks of a source: the features cost more than the probes
                alike = id(prepared.source), prepared.task.unknown_sensor
                groups.setdefault(alike, []).append(prepared)
        for group in groups.values():
            self._group(entry, subjects, group)
        self.writer.write()

    def _group(
        self, entry: ModelEntry, subjects: Sequence[FrozenEncoder], every: Sequence[PreparedTask]
    ) -> None:
        """Runs the unfinished tasks of one source; all of them share features."""
        group = [
            prepared
            for prepared in every
            if not self.writer.kept(prepared.task.name, entry.name, self._key(prepared, subjects))
        ]
        extracted: list[SourceFeatures | None] = []
        frozen = self._frozen(group)
        # also clips of tasks that are done: else a bench that goes on would find no feature again
        clips = [prepared.clips for prepared in self._frozen(every)]
        for subject in subjects if frozen else ():
            try:
                extracted.append(self._features(subject, frozen, np.unique(np.concatenate(clips))))
            except TactileForgeError as error:
                for prepared in group:
                    self._refuse(error, prepared, entry)
                return
        for prepared in Bar(group, desc=f"probes on {entry.name}", unit="task"):
            try:
                self._task(entry, subjects, extracted, prepared)
            except TactileForgeError as error:
                self._refuse(error, prepared, entry)

    def _frozen(self, tasks: Sequence[PreparedTask]) -> list[PreparedTask]:
        """Tasks with a frozen encoder: their probes do not fine-tune it."""
        return [prepared for prepared in tasks if not self.choices[prepared.task.name].finetune]

    def _features(
        self, subject: FrozenEncoder, group: Sequence[PreparedTask], clips: NDArray[np.int64]
    ) -> SourceFeatures:
        kinds = [self.choices[prepared.task.name].kind for prepared in group]
        taps = sorted({tap for kind in kinds for tap in subject.taps(kind)})
        flips = FLIPS if any(prepared.task.flips for prepared in group) else (PLAIN,)
        policy = group[0].task.unknown_sensor
        source = group[0].source
        arrays = extract_features(self.store, subject, source, clips, taps, flips, policy)
        return SourceFeatures(clips, arrays)

    def _task(
        self,
        entry: ModelEntry,
        subjects: Sequence[FrozenEncoder],
        extracted: Sequence[SourceFeatures | None],
        prepared: PreparedTask,
    ) -> None:
        choice = self.choices[prepared.task.name]
        measured: list[tuple[int, evaluate.ProbeResult]] = []
        for number, subject in enumerate(subjects):
            # networks take the seeds in turn, so that the spread is that of both
            seeds = range(number, self.options.seeds, len(subjects))
            done = evaluate.evaluate_probe(
                prepared,
                choice,
                subject,
                None if choice.finetune else extracted[number],
                self.store,
                seeds if choice.kind.trained else [number],
                self.options.selection == "test",
            )
            measured += [
                (result.outcomes[0].seed if choice.kind.trained else number, result)
                for result in done
            ]
        # of the first network alone: a head fits one encoder
        class_heads.keep_class_head(self.writer.folder, prepared, subjects[0], measured[0][1])
        rows = self._cells(entry, prepared, choice, measured)
        self.writer.cells(prepared.task.name, entry.name, self._key(prepared, subjects), rows)

    def _cells(
        self,
        entry: ModelEntry,
        prepared: PreparedTask,
        choice: ProbeChoice,
        measured: Sequence[tuple[int, evaluate.ProbeResult]],
    ) -> list[results.Cell]:
        """Result cells; those of the learning rate best on validation come first."""
        main = prepared.task.metrics[0]
        name = metrics.part_of(main, prepared.target.parts)
        # what is smaller is better from here on
        sign = 1 if metrics.metric_kind(main).better == "lower" else -1
        scores: dict[str, list[float]] = {}
        for _, result in measured:
            scores.setdefault(_name(result), []).append(sign * result.score)
        order = sorted(scores, key=lambda name: sum(scores[name]))
        units, clips = prepared.test_units, prepared.test_clips
        rows: list[results.Cell] = []
        for seed, result in sorted(measured, key=lambda row: (order.index(_name(row[1])), row[0])):
            first = result.outcomes[0]
            cell = results.Cell(
                task=prepared.task.name,
                model=entry.name,
                seed=seed,
                setting=_setting(choice, first),
                metrics=result.metrics,
                epoch=first.epoch,
                curve=result.curve if first.train else {},
            )
            part = prepared.target.parts[name]
            predicted, truth = result.predicted[name], result.truth[name]
            stored = self.writer.predictions(
                *(cell, name, part, predicted, truth, units, clips),
                probability=result.probability.get(name),
                picture=None if rows else prepared.test_picture,  # of the one that the page shows
            )
            rows.append(stored)
        return rows

    def _key(self, prepared: PreparedTask, subjects: Sequence[FrozenEncoder]) -> str:
        """Hash of everything the cells of a task and model depend on."""
        choice = self.choices[prepared.task.name]
        facts = {
            "task": asdict(prepared.task),
            "data": prepared.source.fingerprint,
            "truth": [
                hashlib.sha256(p.truth.numpy().tobytes()).hexdigest()
                for p in prepared.target.parts.values()
            ],
            "probe": [
                choice.kind.__name__,
                choice.options,
                asdict(choice.training),
                choice.finetune,
            ],
            "models": [
                [s.weights, s.preprocessing, s.spacing_of(prepared.task.clip)] for s in subjects
            ],
            "seeds": self.options.seeds,
            "selection": self.options.selection,
            "predictions": 2,  # with probabilities and pictures of what is wrong
        }
        if not choice.kind.fitted:
            # only zero-shot probes read the heads: for others, new heads change no cell
            facts["heads"] = [s.heads_hash for s in subjects]
        return hashlib.sha256(json.dumps(facts, sort_keys=True).encode()).hexdigest()[:24]

    def _knows(
        self, prepared: PreparedTask, entry: ModelEntry, subjects: Sequence[FrozenEncoder]
    ) -> bool:
        # all networks of a row know the same sensors
        strange = subjects[0].unknown(prepared.sensors)
        if not strange or prepared.task.unknown_sensor == "universal":
            return True
        known = ", ".join(subjects[0].encoder.sensors)
        self.writer.not_run(
            f"the model does not know the sensor {', '.join(strange)} (it knows: {known})",
            task=prepared.task.name,
            model=entry.name,
            fix=f"tasks.{prepared.task.name}.unknown_sensor=universal takes the universal tokens",
        )
        return False

    def _refuse(self, error: TactileForgeError, prepared: PreparedTask, entry: ModelEntry) -> None:
        reason, fix = _split(error)
        self.writer.not_run(reason, task=prepared.task.name, model=entry.name, fix=fix)


def _name(result: evaluate.ProbeResult) -> str:
    """Name of the setting of a probe."""
    first = result.outcomes[0]
    return first.reading or str(first.lr)


def _setting(choice: ProbeChoice, first: TrainedProbe) -> dict[str, Any]:
    training = choice.training
    if not choice.kind.trained:
        return dict(choice.options) | ({"reading": first.reading} if first.reading else {})
    setting = {"lr": first.lr, "epochs": training.epochs, "batch": training.batch, **choice.options}
    return setting | ({"encoder_lr": choice.finetune} if choice.finetune else {})


def _model(entry: ModelEntry, subjects: Sequence[FrozenEncoder]) -> results.ResultModel:
    facts = subjects[0].facts
    if entry.folders:
        facts["trainings"] = len(subjects)
    return results.ResultModel(
        name=entry.name,
        title=entry.title,
        group=entry.group,
        recipe=entry.recipe,
        sha256=" ".join(subject.sha256 for subject in subjects),
        facts=facts,
    )


def _source(
    task: Task, known: dict[str, TaskSource | TactileForgeError]
) -> TaskSource | TactileForgeError:
    """The source of a task; tasks with the same data share one."""
    key = json.dumps([task.data, task.sides, asdict(task.clip)], sort_keys=True)
    if key not in known:
        try:
            known[key] = open_source(task.data, task.sides, task.clip)
        except (DataError, PluginError) as error:
            known[key] = error
    return known[key]


def _split(error: TactileForgeError) -> tuple[str, str]:
    """Splits the text of an error into reason and fix."""
    reason, _, fix = str(error).partition(". Download ")
    return reason, f"Download {fix.partition(', and ')[0]}." if fix else ""


def write_outputs(folder: Path) -> str:
    """Writes the tables and the report; returns the tables as Markdown."""
    from tactileforge_bench.output.write import write_all

    write_all(folder)
    return (folder / "table.md").read_text("utf-8")
