"""Counts of unreadable recordings and of labels seen by a run, restored on resume."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from typing import Any

import lightning as L
from lightning.pytorch.callbacks import Callback

from tactileforge.contracts import Batch
from tactileforge.errors import DataError
from tactileforge.training.labels import PATIENCE, Labels
from tactileforge.training.module import TouchModule

log = logging.getLogger(__name__)


class SkippedRecordings(Callback):
    """Counts unreadable recordings and stops a run with too many.

    Args:
        allowed: Largest number of lost recordings; None for any number.

    Attributes:
        skipped: Reason, in one line, and number of lost recordings, by name.
    """

    def __init__(self, allowed: int | None = None) -> None:
        self.allowed = allowed
        self.skipped: dict[str, tuple[str, int]] = {}

    def observe(self, batch: Batch, training: bool) -> None:
        """Counts recordings left out of a batch, while it is on the host."""
        self.skip(batch["skipped"])

    def skip(self, skipped: Mapping[str, tuple[str, int]]) -> None:
        """Adds unreadable recordings.

        Args:
            skipped: Reason and number of lost recordings, by name.

        Raises:
            DataError: More than `allowed` recordings are lost; the message lists them.
        """
        for name, (line, count) in skipped.items():
            if name not in self.skipped:
                self.skipped[name] = line, count
                log.warning("skipped: %s", line)
        lost = sum(count for _, count in self.skipped.values())
        if skipped and self.allowed is not None and lost > self.allowed:
            listed = "\n  ".join(line for line, _ in self.skipped.values())
            raise DataError(
                f"{lost} recordings cannot be read, and data.max_bad allows {self.allowed}; mend "
                f"them, or raise data.max_bad:\n  {listed}"
            )

    def on_save_checkpoint(
        self, trainer: L.Trainer, pl_module: L.LightningModule, checkpoint: dict[str, Any]
    ) -> None:
        """Saves the skipped recordings, for the report of a resumed run."""
        checkpoint["skipped"] = dict(self.skipped)

    def on_load_checkpoint(
        self, trainer: L.Trainer, pl_module: L.LightningModule, checkpoint: dict[str, Any]
    ) -> None:
        """Restores the skipped recordings."""
        self.skipped = dict(checkpoint["skipped"])


class LabelCoverage(Callback):
    """Counts the labels seen by objectives in training.

    Args:
        module: Module of the run.

    Attributes:
        labels: Counts of labels, by objective.
    """

    def __init__(self, module: TouchModule) -> None:
        self.module = module
        self.labels = Labels()

    def observe(self, batch: Batch, training: bool) -> None:
        """Counts the labels of a batch for the active objectives, while it is on the host."""
        for key, weight in (self.module.current_weights() if training else {}).items():
            if weight:
                needs: frozenset[str] = getattr(self.module.objectives[key], "needs", frozenset())
                self.labels.add(key, needs, batch)

    def on_train_end(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        """Warns of objectives without labels in a run too short for the warning during training."""
        for key, count in self.labels.counts.items():
            if count["batches"] < PATIENCE and (line := self.labels.missing(key, has_ended=True)):
                log.warning(line)

    def on_save_checkpoint(
        self, trainer: L.Trainer, pl_module: L.LightningModule, checkpoint: dict[str, Any]
    ) -> None:
        """Saves the counts, for the report of a resumed run."""
        checkpoint["labels"] = {key: dict(count) for key, count in self.labels.counts.items()}

    def on_load_checkpoint(
        self, trainer: L.Trainer, pl_module: L.LightningModule, checkpoint: dict[str, Any]
    ) -> None:
        """Restores the counts."""
        self.labels = Labels(checkpoint["labels"])
