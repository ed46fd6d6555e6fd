"""One cell of the table: a probe of a task on an encoder."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import TypeAlias

import numpy as np
import torch
from numpy.typing import NDArray

from tactileforge.plugins import Bar
from tactileforge_bench.fit import finetune
from tactileforge_bench.fit.features import FLIPS, PLAIN, Array, FeatureStore, Flip
from tactileforge_bench.fit.frozen_encoder import FrozenEncoder
from tactileforge_bench.fit.probes.base import Probe, Values
from tactileforge_bench.fit.probes.knn import Knn
from tactileforge_bench.fit.probes.linear import Linear
from tactileforge_bench.fit.probes.ridge import Ridge
from tactileforge_bench.fit.probes.zero_shot import ZeroShot
from tactileforge_bench.fit.resolve import PreparedTask, ProbeChoice
from tactileforge_bench.fit.training import Examples, TrainedProbe, train_probes
from tactileforge_bench.tasks import metrics, splits
from tactileforge_bench.tasks.splits import Split

#: Places of the clips to train on, to select on, and to test on.
Uses: TypeAlias = tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]


@dataclass(frozen=True)
class SourceFeatures:
    """Features of the clips of a source.

    Attributes:
        clips: int64 (n,), ascending: which clips.
        arrays: float16 (n, ...), by tap and flip.
    """

    clips: NDArray[np.int64]
    arrays: Mapping[tuple[str, Flip], Array]


@dataclass(frozen=True)
class ProbeResult:
    """A tested probe, over all folds.

    Attributes:
        outcomes: Trained probe of each fold.
        predicted: Predictions of each part, (n, columns), in the units of the truth.
        truth: True values of each part, (n, columns).
        metrics: Values by name.
        probability: Probabilities of the classes, (n, columns, classes) of each part; empty for
            probes without.
        layer: Layer of a linear probe, fitted again to all clips: its penalty, and float64
            (width + 1, outputs) of each part.
    """

    outcomes: Sequence[TrainedProbe]
    predicted: Values
    truth: Values
    metrics: dict[str, float]
    probability: Values = field(default_factory=dict)
    layer: tuple[float, Values] | None = None

    @property
    def score(self) -> float:
        """Mean over the folds of the metric used for selection."""
        return sum(outcome.score for outcome in self.outcomes) / len(self.outcomes)

    @property
    def curve(self) -> dict[str, list[float]]:
        """Losses by epoch, means over the folds."""
        losses = {
            "train": [outcome.train for outcome in self.outcomes],
            "validation": [outcome.validation for outcome in self.outcomes],
        }
        return {name: np.mean(rows, axis=0).tolist() for name, rows in losses.items()}


def evaluate_probe(
    prepared: PreparedTask,
    choice: ProbeChoice,
    subject: FrozenEncoder,
    features: SourceFeatures | None,
    store: FeatureStore,
    seeds: Sequence[int],
    select_on_test: bool = False,
) -> list[ProbeResult]:
    """Trains and tests the probes of a task on an encoder.

    Args:
        prepared: The task.
        choice: Choice of the probe.
        subject: The encoder.
        features: Features of its clips, or of more; None where the encoder is trained too.
        store: Options for reading clips where the encoder is trained too.
        seeds: Seeds of the probes; one is enough if nothing is drawn.
        select_on_test: Whether the best epoch is chosen on the test clips.

    Returns:
        One result a learning rate and seed, rates first.

    Raises:
        DataError: Losses or metrics are not finite; or a clip cannot be read.
        ConfigError: The probe does not fit the encoder.
    """
    main, target = prepared.task.metrics[0], prepared.target
    higher = metrics.metric_kind(main).better == "higher"
    width = subject.width(choice.kind.tap)
    build = partial(choice.build, width, target)
    folds: list[list[TrainedProbe]] = []
    parts = prepared.splits
    for split in Bar(parts, desc="folds", unit="fold", leave=False) if len(parts) > 1 else parts:
        select = split.test if select_on_test else split.validation
        score, uses = _scorer(prepared, select), (split.train, select, split.test)
        if features is None:
            # the encoder changes in every step, so there are no features to keep
            fold = finetune.finetune_encoder(
                prepared, choice, subject, store, uses, seeds, score, higher
            )
            folds.append(fold)
            continue
        taps = subject.taps(choice.kind)
        examples = [_examples(prepared, tap, features, subject) for tap in taps]
        # trained probes first: the others are solved or counted, without epochs and seeds
        if choice.kind.trained:
            fold = train_probes(build, choice.training, examples[0], uses, seeds, score, higher)
        elif issubclass(choice.kind, Ridge):
            sizes = [tuple(subject.group_sizes.values()) if t == "groups" else () for t in taps]
            fold = [
                _solve(prepared, build(), rows, split, tap, count)
                for tap, rows, count in zip(taps, examples, sizes, strict=True)
            ]
        elif issubclass(choice.kind, ZeroShot):
            fold = [_name(build(), examples[0], split, subject)]
        elif issubclass(choice.kind, Linear):
            fold = [_converge(build(), examples[0], split, select, score, higher)]
        else:
            fold = [_vote(build(), examples[0], uses, score)]
        folds.append(fold)
    results = [_result(prepared, outcomes) for outcomes in zip(*folds, strict=True)]
    if features is None or not issubclass(choice.kind, Linear):
        return results
    layer = _layer(build(), examples[0], prepared.splits, folds)
    return [replace(result, layer=layer) for result in results]


def _examples(
    prepared: PreparedTask, tap: str, features: SourceFeatures, subject: FrozenEncoder
) -> Examples:
    flips = FLIPS if prepared.task.flips else (PLAIN,)
    parts = prepared.target.parts.items()
    return Examples(
        {flip: features.arrays[tap, flip] for flip in flips},
        np.searchsorted(features.clips, prepared.target.clips),
        {flip: {name: part.flipped(*flip).normalised for name, part in parts} for flip in flips},
        subject.device,
    )


def _scorer(prepared: PreparedTask, places: NDArray[np.int64]) -> Callable[[Values], float]:
    """The main metric of normalised predictions on some clips."""
    main = prepared.task.metrics[0]
    name = metrics.part_of(main, prepared.target.parts)
    part = prepared.target.parts[name]
    scale, truth = part.scale[places], part.truth[places]
    # probes predict in normalised units, metrics are in those of the label
    return lambda decoded: metrics.measure(main, part, decoded[name] * scale, truth)


def _vote(
    model: Probe, examples: Examples, uses: Uses, score: Callable[[Values], float]
) -> TrainedProbe:
    assert isinstance(model, Knn)
    known, truth = examples.take(uses[0])
    decoded = [model.vote(known, truth, examples.take(places)[0]) for places in uses[1:]]
    on_cpu = [{key: value.cpu() for key, value in values.items()} for values in decoded]
    return TrainedProbe(0, math.nan, on_cpu[1], score=score(on_cpu[0]))


def _name(model: Probe, examples: Examples, split: Split, subject: FrozenEncoder) -> TrainedProbe:
    """Names test clips by words; nothing is fitted, nor selected."""
    assert isinstance(model, ZeroShot)
    text = {
        name: subject.language.vectors(words, model.template, model.text_encoder, subject.device)
        for name, words in model.words.items()
    }
    chosen = model.choose(examples.take(split.test)[0], text)
    return TrainedProbe(0, math.nan, {name: values.cpu() for name, values in chosen.items()})


def _converge(
    model: Probe,
    examples: Examples,
    split: Split,
    select: NDArray[np.int64],
    score: Callable[[Values], float],
    higher: bool,
) -> TrainedProbe:
    """Fits until it has converged; the penalty is chosen first, then all known clips are used."""
    assert isinstance(model, Linear)
    asked = examples.take(select)[0]
    penalty, value = model.choose(*examples.every(split.train), asked, score, higher)
    layer = model.fit(*examples.every(split.known), penalty)
    asked = examples.take(split.test)[0]
    shares = model.probabilities(model.scores(layer, asked))
    return TrainedProbe(
        0,
        math.nan,
        model.predict(layer, asked),
        {name: values.float().cpu() for name, values in shares.items()},
        value,
        penalty=penalty,
    )


def _layer(
    model: Probe,
    examples: Examples,
    all_splits: Sequence[Split],
    folds: Sequence[Sequence[TrainedProbe]],
) -> tuple[float, Values]:
    """The layer fitted to all clips, with the median penalty of the folds."""
    assert isinstance(model, Linear)
    penalty = sorted(fold[0].penalty for fold in folds)[len(folds) // 2]
    # of all clips: the layer is for pictures to come, and its metrics are those of the folds
    used = np.unique(np.concatenate([split.every for split in all_splits]))
    return penalty, model.fit(*examples.every(used), penalty)


def _solve(
    prepared: PreparedTask,
    model: Probe,
    examples: Examples,
    split: Split,
    tap: str,
    sizes: Sequence[int],
) -> TrainedProbe:
    """Fits in closed form on training and validation clips; inner folds choose what is chosen."""
    assert isinstance(model, Ridge)
    known, plan = split.known, prepared.task.split
    groups = splits.group_names(prepared.source, prepared.target, known, plan.group)
    # inner folds need two groups at least: take the unit of the intervals
    if len(set(groups)) == 1 and plan.unit:
        groups = splits.group_names(prepared.source, prepared.target, known, plan.unit)
    rows, truth = examples.take(known)
    inner, outer = model.solve(rows, truth, groups, examples.take(split.test)[0], sizes)
    score = _scorer(prepared, known)({name: values.cpu() for name, values in inner.items()})
    predicted = {name: values.cpu() for name, values in outer.items()}
    return TrainedProbe(0, math.nan, predicted, score=score, reading=tap)


def _result(prepared: PreparedTask, outcomes: Sequence[TrainedProbe]) -> ProbeResult:
    parts = prepared.target.parts
    test = np.concatenate([split.test for split in prepared.splits])
    predicted = {
        name: torch.cat([outcome.predicted[name] for outcome in outcomes]) * part.scale[test]
        for name, part in parts.items()
    }
    truth = {name: part.truth[test] for name, part in parts.items()}
    shares = {
        name: torch.cat([outcome.probability[name] for outcome in outcomes])
        for name in outcomes[0].probability
    }
    values = {}
    for metric in prepared.task.metrics:
        name = metrics.part_of(metric, parts)
        values[metric] = metrics.measure(metric, parts[name], predicted[name], truth[name])
    return ProbeResult(outcomes, predicted, truth, values, shares)
