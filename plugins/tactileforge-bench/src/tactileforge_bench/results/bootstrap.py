"""Scores as sums over groups, and the paired bootstrap over groups.

Every test clip is scored, clips of one recording (or object) are drawn together, with replacement,
and differences are taken within a draw; intervals are percentiles. Of several networks, as random
weights of three seeds, some are drawn each time too, so that their spread counts.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactileforge.errors import DataError
from tactileforge_bench.results.predictions import read_predictions

#: Metrics that are sums over clips.
METRICS = ("accuracy", "balanced_accuracy", "r2", "r2_bounded")
#: Draws of groups; ends of intervals are percentiles 2.5 and 97.5 of them.
DRAWS = 2000
# Any number (a date), but always the same: a gate is reproduced to the last digit.
_SEED = 20261122

Sums = NDArray[np.float64]


@dataclass(frozen=True)
class GroupedScore:
    """A score as sums over groups: the bootstrap over groups becomes a matrix product.

    The score is ``start + sign * mean_k(top_k / bottom_k)``, tops and bottoms summed over groups.

    Attributes:
        groups: Names, in the order of the rows.
        top: float64 (groups, k).
        bottom: float64 (groups, k).
        start: 0, or 1 for a coefficient of determination.
        sign: 1, or -1 for that.
        floor: Least score.
    """

    groups: tuple[str, ...]
    top: Sums
    bottom: Sums
    start: float
    sign: float
    floor: float = -np.inf

    def scores(self, counts: Sums) -> Sums:
        """Scores (draws,) from the number of times each group was drawn, (draws, groups)."""
        top, bottom = counts @ self.top, counts @ self.bottom
        # a draw may miss a class entirely: its recall is left out of the mean
        there = bottom > 0
        share = np.divide(top, bottom, out=np.zeros_like(top), where=there)
        scores = self.start + self.sign * share.sum(1) / np.maximum(there.sum(1), 1)
        bounded: Sums = np.maximum(scores, self.floor)
        return bounded


def grouped_score(path: Path, metric: str) -> GroupedScore:
    """Scores of the test clips of a cell.

    Args:
        path: File of its predictions.
        metric: One of `METRICS`.

    Raises:
        DataError: The file does not say which clips belong together, or the metric is not in
            `METRICS`.
    """
    predictions = read_predictions(path)
    with np.load(path, allow_pickle=False) as file:
        if "units" not in file.files:
            raise DataError(f"{path}: array 'units' is missing; run the bench again")
        names, of = np.unique(file["units"], return_inverse=True)
    is_r2 = metric in ("r2", "r2_bounded")
    if is_r2:
        # deviations are from the mean of all clips, not of a draw: else they do not sum over groups
        truth = predictions.truth.astype(float)
        error = (predictions.predicted - predictions.truth).astype(float)
        parts = error**2, (truth - truth.mean(0)) ** 2
    elif metric in ("accuracy", "balanced_accuracy"):
        # one column per class gives the mean recall, one column for all the accuracy
        right = (predictions.truth == predictions.predicted).astype(float)
        per_class = predictions.truth[:, :1] == np.unique(predictions.truth)
        classes = per_class if metric != "accuracy" else [[True]]
        parts = right * classes, np.ones_like(right) * classes
    else:
        raise DataError(f"{path}: the gate knows {', '.join(METRICS)}, not {metric}")
    sums = [np.zeros((len(names), part.shape[1])) for part in parts]
    for total, part in zip(sums, parts, strict=True):
        np.add.at(total, of, part)
    start, sign = (1.0, -1.0) if is_r2 else (0.0, 1.0)
    floor = 0.0 if metric == "r2_bounded" else -np.inf
    return GroupedScore(tuple(names.tolist()), sums[0], sums[1], start, sign, floor)


@dataclass(frozen=True)
class ScoreInterval:
    """A score, or a difference of two, with its 95 % interval.

    Attributes:
        value: The score; of classes as a share.
        low: Lower end.
        high: Upper end.
    """

    value: float
    low: float
    high: float


def compared(tallies: Sequence[GroupedScore], others: Sequence[GroupedScore] = ()) -> ScoreInterval:
    """Bootstrap of the mean score of some networks, or of its lead over other networks.

    Args:
        tallies: Scores of the networks, one each.
        others: Scores of the other networks, one each; empty to give the score itself.

    Raises:
        DataError: They were not tested on the same groups.
    """
    value, draws = _bootstrap(tallies, others)
    return _interval(value, draws)


def compared_over_tasks(
    tasks: Sequence[tuple[Sequence[GroupedScore], Sequence[GroupedScore]]],
) -> ScoreInterval:
    """Mean over tasks of the results of `compared`; tasks are drawn from independently.

    Args:
        tasks: Networks and others of each task; see `compared`.

    Raises:
        DataError: The networks of a task were not tested on the same groups.
    """
    # a seed for each task: tasks have groups of their own, and are drawn independently
    parts = [_bootstrap(*task, seed=_SEED + number) for number, task in enumerate(tasks)]
    return _interval(
        float(np.mean([value for value, _ in parts])), np.mean([draws for _, draws in parts], 0)
    )


def _interval(value: float, draws: Sums) -> ScoreInterval:
    low, high = np.quantile(draws, (0.025, 0.975))
    return ScoreInterval(value, float(low), float(high))


def _bootstrap(
    tallies: Sequence[GroupedScore], others: Sequence[GroupedScore] = (), seed: int = _SEED
) -> tuple[float, Sums]:
    """Mean score or difference, and those of ``DRAWS`` draws; see `compared`."""
    every = [*tallies, *others]
    groups = every[0].groups
    if any(network.groups != groups for network in every):
        raise DataError("models were tested on other recordings; run the bench again, all at once")
    # the same draws of groups for all networks: the test is paired
    counts, state = _draws(seed, len(groups))
    rng = np.random.default_rng(seed)
    rng.bit_generator.state = state
    all_once = np.ones((1, len(groups)))

    def drawn(networks: Sequence[GroupedScore]) -> Sums:
        table = np.stack([network.scores(counts) for network in networks])
        # networks are drawn too, so that the interval covers the spread of seeds
        chosen = rng.integers(len(networks), size=(len(networks), DRAWS))
        means: Sums = np.take_along_axis(table, chosen, axis=0).mean(0)
        return means

    values = drawn(tallies) - drawn(others) if others else drawn(tallies)
    mean = np.mean([network.scores(all_once) for network in tallies])
    mean -= np.mean([network.scores(all_once) for network in others]) if others else 0.0
    return float(mean), values


@lru_cache(maxsize=16)
def _draws(seed: int, groups: int) -> tuple[Sums, Mapping[str, Any]]:
    """How often each group is drawn, float64 (DRAWS, groups), and the generator's state after it.

    They are the same for every model of a task, and take most of the time.
    """
    rng = np.random.default_rng(seed)
    counts = rng.multinomial(groups, np.full(groups, 1 / groups), DRAWS).astype(float)
    counts.flags.writeable = False
    return counts, rng.bit_generator.state
