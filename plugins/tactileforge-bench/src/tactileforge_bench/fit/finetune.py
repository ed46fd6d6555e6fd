"""Full fine-tuning: the encoder is trained with the probe, so features cannot be cached."""

from __future__ import annotations

import copy
import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from tactileforge.errors import ConfigError, DataError
from tactileforge.plugins import Bar
from tactileforge_bench.fit.features import FLIPS, PLAIN, FeatureStore, read_batches, readers
from tactileforge_bench.fit.frozen_encoder import FrozenEncoder
from tactileforge_bench.fit.probes.base import Values
from tactileforge_bench.fit.resolve import PreparedTask, ProbeChoice
from tactileforge_bench.fit.training import Schedule, TrainedProbe, seeded_probe


def finetune_encoder(
    prepared: PreparedTask,
    choice: ProbeChoice,
    subject: FrozenEncoder,
    store: FeatureStore,
    uses: tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]],
    seeds: Sequence[int],
    score: Callable[[Values], float],
    higher: bool,
) -> list[TrainedProbe]:
    """Trains encoder and probe, separately for each learning rate and seed.

    Args:
        prepared: The task.
        choice: Choice of the probe; ``choice.finetune`` is the learning rate of the encoder.
        subject: The encoder; it is left as it was.
        store: Options for reading clips; see `FeatureStore`.
        uses: Clips to train on, to select on, and to test on.
        seeds: Seeds of the probes.
        score: Metric of predictions on the clips to select on.
        higher: Whether a higher score is better.

    Raises:
        ConfigError: Frames of several sizes cannot be batched.
        DataError: A loss is not finite, or a clip cannot be read.
    """
    outcomes = []
    for lr in choice.training.lr:
        for seed in seeds:
            run = _Run(prepared, choice, subject, store, seed, lr)
            outcomes.append(run.train(uses, score, higher))
    return outcomes


class _Run:
    """One encoder and one probe."""

    def __init__(
        self,
        prepared: PreparedTask,
        choice: ProbeChoice,
        subject: FrozenEncoder,
        store: FeatureStore,
        seed: int,
        lr: float,
    ) -> None:
        self.task, self.target, self.choice, self.store = (
            prepared.task,
            prepared.target,
            choice,
            store,
        )
        by_size = list(readers(subject, prepared.source, prepared.target.clips))
        if len(by_size) > 1:
            raise ConfigError(
                f"task {self.task.name}: frames have several sizes, which cannot be batched; "
                "fine-tune on the recordings of one sensor"
            )
        self.clips = by_size[0][0]
        # copies: the next task, seed and learning rate start from the weights as they were
        self.subject = copy.copy(subject)
        self.subject.encoder = copy.deepcopy(subject.encoder).requires_grad_(True)
        self.tap = choice.kind.tap
        width = subject.width(self.tap)
        self.probe = seeded_probe(lambda: choice.build(width, prepared.target), seed).to(
            subject.device
        )
        self.outcome = TrainedProbe(seed, lr)
        self.truth = {
            flip: {k: part.flipped(*flip).normalised for k, part in self.target.parts.items()}
            for flip in (FLIPS if self.task.flips else (PLAIN,))
        }

    def train(
        self, uses: tuple[Any, Any, Any], score: Callable[[Values], float], higher: bool
    ) -> TrainedProbe:
        training, outcome = self.choice.training, self.outcome
        groups = [
            {"params": list(self.probe.parameters()), "lr": outcome.lr},
            {"params": list(self.subject.encoder.parameters()), "lr": self.choice.finetune},
        ]
        total = max(1, training.epochs * math.ceil(len(uses[0]) / training.batch))
        schedule = Schedule(groups, training, total)
        best: dict[str, Tensor] = {}
        for epoch in Bar(range(1, training.epochs + 1), desc=f"fine-tuning {self.subject.name}"):
            # an order of its own for each epoch and seed, whatever was drawn before
            rng, losses = np.random.default_rng([epoch, outcome.seed]), []
            for places, batch in self._batches(rng.permutation(uses[0])):
                flips = list(self.truth)
                flip = flips[int(rng.integers(len(flips)))]
                loss, _ = self._forward(places, batch, flip)
                schedule.step(loss)
                losses.append(float(loss.detach()))
            if not np.isfinite(losses).all():
                raise DataError(f"the loss is not finite in epoch {epoch}; lower probe.finetune")
            outcome.train.append(float(np.mean(losses)))
            loss_now, decoded = self._predict(uses[1])
            outcome.validation.append(loss_now)
            value = score(decoded)
            if outcome.epoch < 0 or (value > outcome.score if higher else value < outcome.score):
                outcome.score, outcome.epoch = value, epoch
                best = {k: v.detach().clone() for k, v in self._module().state_dict().items()}
        if best:
            self._module().load_state_dict(best)
        outcome.predicted = self._predict(uses[2])[1]
        return outcome

    def _module(self) -> torch.nn.ModuleList:
        # of both: the best epoch is one state
        return torch.nn.ModuleList([self.probe, self.subject.encoder])

    def _forward(self, places: Any, batch: Any, flip: Any) -> tuple[Tensor, Values]:
        out = self.probe(self.subject.run(batch, flip, self.task.unknown_sensor)[self.tap])
        truth = {k: v[places].to(self.subject.device) for k, v in self.truth[flip].items()}
        return self.probe.loss(out, truth), out

    @torch.no_grad()
    def _predict(self, places: Any) -> tuple[float, Values]:
        total, batches = 0.0, []
        for some, batch in self._batches(places):
            loss, out = self._forward(some, batch, PLAIN)
            total += float(loss) * len(some) / len(places)
            batches.append({k: v.cpu() for k, v in self.probe.decode(out).items()})
        return total, {k: torch.cat([decoded[k] for decoded in batches]) for k in batches[0]}

    def _batches(self, places: Any) -> Any:
        size = self.choice.training.batch
        for number, batch in enumerate(read_batches(self.clips, places.tolist(), self.store, size)):
            yield places[number * size : (number + 1) * size], batch
