"""Online probe of held-out touches during training."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import lightning as L
import torch
from lightning.pytorch.callbacks import Callback
from torch import Tensor
from torch.nn.functional import normalize

from tactileforge.contracts import Batch
from tactileforge.encoders.views import views_of
from tactileforge.errors import ConfigError

#: Targets: label of the batch, and whether it is a class.
_TARGETS = {"object": True, "action": True, "force": False}


class Probe(Callback):
    """Reads a label from the features at each validation: k-NN for classes, ridge for forces.

    Logs ``val/probe_object`` or ``val/probe_action``, the share of held-out clips whose nearest
    training clips vote for their class, or ``val/probe_force``, R2 of normal force by ridge
    regression.

    Args:
        target: ``object``, ``action`` or ``force``.
        batches: Training batches to read features of.
        neighbors: Neighbours that vote.
        every: Validations between two probes.

    Raises:
        ConfigError: An unknown target, or a number below 1.
    """

    def __init__(
        self, target: str = "object", batches: int = 8, neighbors: int = 5, every: int = 1
    ) -> None:
        if target not in _TARGETS:
            raise ConfigError(f"target={target!r}: give one of {', '.join(_TARGETS)}")
        if min(batches, neighbors, every) < 1:
            raise ConfigError("batches, neighbors and every: give 1 or more")
        self.target, self.batches, self.neighbors, self.every = target, batches, neighbors, every
        self._count = 0

    def on_validation_epoch_end(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        """Reads features of training and held-out clips, and logs the score."""
        self._count += 1
        data: Any = getattr(trainer, "datamodule", None)
        if trainer.sanity_checking or self._count % self.every or not getattr(data, "val", None):
            return
        state = torch.get_rng_state()  # drawn by nothing else: the run stays the same to the bit
        try:
            train = self._read(_first(data.stream(), self.batches), pl_module)
            held = self._read(_first(data.val_stream(), self.batches), pl_module)
        finally:
            torch.set_rng_state(state)
        if len(train[1]) > self.neighbors and len(held[1]):
            score = self._vote(train, held) if _TARGETS[self.target] else _ridge(train, held)
            pl_module.log(f"val/probe_{self.target}", score, rank_zero_only=True)

    @torch.no_grad()
    def _read(self, batches: Iterator[Batch], module: Any) -> tuple[Tensor, Tensor]:
        """Features (N, width) and labels (N,) of the clips with a label."""
        was_training = module.encoder.training
        module.encoder.eval()
        features, labels = [], []
        for batch in batches:
            label, known = self._label(batch)
            if not known.any():
                continue
            moved = {
                k: v.to(module.device) if isinstance(v, Tensor) else v for k, v in batch.items()
            }
            tokens = views_of(module.encoder, moved, 0.0).full.tokens.float().flatten(1, -2)
            summary = torch.cat([tokens.mean(1), tokens.std(1)], 1)
            features.append(summary.cpu()[known])
            labels.append(label[known])
        module.encoder.train(was_training)
        if not features:
            return torch.zeros(0, 1), torch.zeros(0)
        return torch.cat(features), torch.cat(labels)

    def _label(self, batch: Batch) -> tuple[Tensor, Tensor]:
        if self.target == "force":
            return batch["force"][:, -1, 2].float(), batch["force_valid"][:, 2]
        label = batch[self.target]
        return label, label >= 0

    def _vote(self, train: tuple[Tensor, Tensor], held: tuple[Tensor, Tensor]) -> float:
        mean = train[0].mean(0)
        near = normalize(held[0] - mean) @ normalize(train[0] - mean).T
        votes = train[1][near.topk(self.neighbors).indices]
        return float((votes.mode(1).values == held[1]).float().mean())


def _first(batches: Any, count: int) -> Iterator[Batch]:
    return (batches[number] for number in range(min(count, len(batches))))


def _ridge(train: tuple[Tensor, Tensor], held: tuple[Tensor, Tensor]) -> float:
    """R2 on held-out clips of a ridge regression; its penalty is a hundredth of the variance."""
    mean, scale = train[0].mean(0), train[0].std(0).clamp_min(1e-6)
    x, rest = ((one[0] - mean) / scale for one in (train, held))
    middle = train[1].mean()
    kernel = x @ x.T
    penalty = 0.01 * kernel.diagonal().mean() * torch.eye(len(x))
    weights = torch.linalg.solve(kernel + penalty, train[1] - middle)
    errors = held[1] - (rest @ (x.T @ weights) + middle)
    return float(1 - errors.square().sum() / (held[1] - held[1].mean()).square().sum())
