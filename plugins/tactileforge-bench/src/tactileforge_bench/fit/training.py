"""Trains many probes at once, on the same batches in the same order."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.func import functional_call, vmap

from tactileforge.errors import ConfigError, DataError
from tactileforge_bench.fit.features import PLAIN, Array, Flip
from tactileforge_bench.fit.probes.base import Probe, ProbeTraining, Values

#: Clips that are predicted at once.
_CHUNK = 256

Params = dict[str, Tensor]


@dataclass(frozen=True)
class Examples:
    """Features and targets, mapped into memory.

    Attributes:
        features: Mapped arrays (m, ...), by flip.
        rows: int64 (n,), row of each example in them.
        truth: Normalised truth (n, columns) of each part, by flip.
        device: Device of the probes' training.
    """

    features: dict[Flip, Array]
    rows: NDArray[np.int64]
    truth: dict[Flip, Values]
    device: torch.device

    def take(self, places: NDArray[np.int64], flip: Flip = PLAIN) -> tuple[Tensor, Values]:
        """Features, float32, and truth of the given clips."""
        rows = torch.from_numpy(np.asarray(self.features[flip][self.rows[places]])).to(self.device)
        truth = {name: values[places].to(self.device) for name, values in self.truth[flip].items()}
        return rows.float(), truth

    def every(self, places: NDArray[np.int64]) -> tuple[Tensor, Values]:
        """Features and truth of clips, each in all its mirror images."""
        taken = [self.take(places, flip) for flip in self.features]
        truth = {name: torch.cat([rows[name] for _, rows in taken]) for name in taken[0][1]}
        return torch.cat([rows for rows, _ in taken]), truth

    def mirrored(
        self, places: NDArray[np.int64], rng: np.random.Generator
    ) -> tuple[Tensor, Values]:
        """Features and truth of clips, each mirrored with probability 1/2 in each direction."""
        flips = list(self.features)
        if len(flips) == 1:
            return self.take(places)
        drawn = rng.integers(len(flips), size=len(places))
        rows, truth = self.take(places, flips[0])
        for number, flip in enumerate(flips[1:], start=1):
            chosen = np.flatnonzero(drawn == number)
            if len(chosen):
                other, labels = self.take(places[chosen], flip)
                rows[chosen] = other
                for name, values in labels.items():
                    truth[name][chosen] = values
        return rows, truth


@dataclass
class TrainedProbe:
    """One probe after its training.

    Attributes:
        seed: Seed of its first weights.
        lr: Learning rate.
        predicted: Predictions on the test clips, normalised, of its best epoch.
        probability: Probabilities of the classes on the test clips, (n, columns, classes) of each
            part of classes; empty for probes without.
        score: Score on the validation clips, in that epoch.
        epoch: Best epoch, from 1; -1 where nothing is trained.
        reading: Features that it reads, where its kind reads several.
        penalty: Chosen penalty of a linear probe.
        train: Loss of each epoch.
        validation: Loss of the validation clips after each.
    """

    seed: int
    lr: float
    predicted: Values = field(default_factory=dict)
    probability: Values = field(default_factory=dict)
    score: float = math.nan
    epoch: int = -1
    reading: str = ""
    penalty: float = math.nan
    train: list[float] = field(default_factory=list)
    validation: list[float] = field(default_factory=list)


class Schedule:
    """Optimiser of probes, and the learning rate of each of its steps.

    Args:
        groups: Parameter groups of the optimiser, each with its ``lr``.
        training: Options of the training.
        steps: Number of steps.

    Raises:
        ConfigError: The optimiser or the schedule is unknown.
    """

    def __init__(
        self, groups: Sequence[dict[str, Any]], training: ProbeTraining, steps: int
    ) -> None:
        kinds: dict[str, Any] = {"adamw": torch.optim.AdamW, "adam": torch.optim.Adam}
        if training.optimiser not in kinds or training.schedule not in ("cosine", "constant"):
            raise ConfigError(
                f"probe: optimiser={training.optimiser}, schedule={training.schedule}: give adamw "
                "or adam, and cosine or constant"
            )
        self.rates = [group["lr"] for group in groups]
        self.optimiser: torch.optim.Optimizer = kinds[training.optimiser](
            list(groups), betas=training.betas, weight_decay=training.weight_decay
        )
        self.cosine, self.steps, self.done = training.schedule == "cosine", steps, 0

    def step(self, loss: Tensor) -> None:
        """Takes one step along the gradient of a scalar."""
        if self.cosine:
            factor = 0.5 * (1 + math.cos(math.pi * self.done / self.steps))
            for group, rate in zip(self.optimiser.param_groups, self.rates, strict=True):
                group["lr"] = rate * factor
        self.optimiser.zero_grad(set_to_none=True)
        loss.backward()  # type: ignore[no-untyped-call]
        self.optimiser.step()
        self.done += 1


class ProbeEnsemble:
    """An ensemble of probes of one kind, trained on the same batches.

    Each member has parameters and an optimiser of its own, so it becomes what it would become
    alone; only the passes are shared.

    Args:
        probes: The members, on one device.
        rates: Learning rate of each.
        training: Other training options.
        steps: Optimiser steps in all.
    """

    def __init__(
        self, probes: Sequence[Probe], rates: Sequence[float], training: ProbeTraining, steps: int
    ) -> None:
        self.model = probes[0]
        self.params = [dict(probe.named_parameters()) for probe in probes]
        groups = [
            {"params": list(params.values()), "lr": rate}
            for params, rate in zip(self.params, rates, strict=True)
        ]
        self.schedule = Schedule(groups, training, steps)

    def _stacked(self) -> Params:
        return {
            name: torch.stack([params[name] for params in self.params]) for name in self.params[0]
        }

    def step(self, rows: Tensor, truth: Values) -> Tensor:
        """Takes one optimiser step; returns the loss of each member before it."""

        def loss(params: Params) -> Tensor:
            return self.model.loss(functional_call(self.model, params, (rows,)), truth)

        losses: Tensor = vmap(loss)(self._stacked())
        # members share no parameter, so the gradient of the sum is each member's own
        self.schedule.step(losses.sum())
        return losses.detach()

    @torch.no_grad()
    def predict(
        self,
        examples: Examples,
        places: NDArray[np.int64],
        read: Callable[[Values], Values] | None = None,
    ) -> tuple[Tensor, Values]:
        """Loss (members,) and predictions (members, n, ...) of some clips.

        Args:
            examples: Features and truth.
            places: The clips.
            read: What is read of the probe's output; None for `Probe.decode`.
        """
        read = read or self.model.decode
        stacked, total, batches = self._stacked(), torch.zeros(len(self.params)), []
        for some in np.split(places, range(_CHUNK, len(places), _CHUNK)):
            rows, truth = examples.take(some)

            def run(
                params: Params, rows: Tensor = rows, truth: Values = truth
            ) -> tuple[Tensor, Values]:
                out = functional_call(self.model, params, (rows,))
                return self.model.loss(out, truth), read(out)

            losses, decoded = vmap(run)(stacked)
            total += losses.cpu() * len(some) / len(places)
            batches.append(decoded)
        return total, {
            name: torch.cat([batch[name] for batch in batches], 1).cpu() for name in batches[0]
        }

    def copies(self, member: int) -> Params:
        """Copies of the current parameters of a member."""
        return {name: value.detach().clone() for name, value in self.params[member].items()}

    def restore(self, member: int, kept: Params) -> None:
        """Restores copied parameters."""
        with torch.no_grad():
            for name, value in self.params[member].items():
                value.copy_(kept[name])


def train_probes(
    build: Callable[[], Probe],
    training: ProbeTraining,
    examples: Examples,
    uses: tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]],
    seeds: Sequence[int],
    score: Callable[[Values], float],
    higher: bool,
) -> list[TrainedProbe]:
    """Trains a probe for each seed and learning rate, in one pass over the data.

    A seed draws the first weights. Batches, and mirror images, are the same for all, and so is
    their order.

    Args:
        build: Constructor of a new probe with random weights.
        training: Training options of the probe.
        examples: Features and truth.
        uses: Clips to train on, to select on, and to test on.
        seeds: Seeds of the probes.
        score: Metric of predictions on the clips to select on; called once a member and epoch.
        higher: Whether a higher score is better.

    Returns:
        One outcome a rate and seed, rates first.

    Raises:
        DataError: A loss or a score is not finite.
    """
    train_on, select_on, test_on = uses
    outcomes = [TrainedProbe(seed, lr) for lr in training.lr for seed in seeds]
    probes = [seeded_probe(build, outcome.seed).to(examples.device) for outcome in outcomes]
    batches = math.ceil(len(train_on) / training.batch)
    members = ProbeEnsemble(
        probes, [outcome.lr for outcome in outcomes], training, max(1, training.epochs * batches)
    )
    best: list[Params] = [{} for _ in outcomes]
    for epoch in range(1, training.epochs + 1):
        total = torch.zeros(len(outcomes))
        # the order depends on epoch and number of clips alone: all members and all runs share it
        rng = np.random.default_rng([epoch, len(train_on)])
        order = rng.permutation(train_on)
        for some in np.split(order, range(training.batch, len(order), training.batch)):
            # in the order of the file: features are mapped, and rows side by side read faster
            batch = examples.mirrored(np.sort(some), rng)
            total += members.step(*batch).cpu() * len(some) / len(train_on)
        losses, decoded = members.predict(examples, select_on)
        # once an epoch: the sum of its losses is finite only if all of them are
        if not torch.isfinite(total).all():
            raise DataError(f"the loss of a probe is not finite in epoch {epoch}; lower probe.lr")
        for i, outcome in enumerate(outcomes):
            outcome.train.append(float(total[i]))
            outcome.validation.append(float(losses[i]))
            value = score({name: values[i] for name, values in decoded.items()})
            if outcome.epoch < 0 or (value > outcome.score if higher else value < outcome.score):
                outcome.score, outcome.epoch, best[i] = value, epoch, members.copies(i)
    # the best epoch of each member, before the test clips are seen
    for i, kept in enumerate(best):
        if kept:
            members.restore(i, kept)
    _, decoded = members.predict(examples, test_on)
    _, shares = members.predict(examples, test_on, members.model.probabilities)
    for i, outcome in enumerate(outcomes):
        outcome.predicted = {name: values[i] for name, values in decoded.items()}
        outcome.probability = {name: values[i] for name, values in shares.items()}
    return outcomes


def seeded_probe(build: Callable[[], nn.Module], seed: int) -> Probe:
    """Builds a probe with seeded weights; the state of the generator is restored."""
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        probe = build()
    assert isinstance(probe, Probe)
    return probe
