"""Counts of unreadable recordings and of labels that a run meets; kept over a resume."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from typing import Any

import lightning as L
from lightning.pytorch.callbacks import Callback

from tactileforge.contracts import Batch
from tactileforge.errors import DataError
from tactileforge.labels import PATIENCE, Labels
from tactileforge.module import TouchModule

log = logging.getLogger(__name__)


class SkippedRecordings(Callback):
    """Counts recordings that cannot be read, and stops a run that loses too many.

    Args:
        allowed: How many may be lost; None for any number.

    Attributes:
        skipped: By name, a line that says why, and how many recordings it costs.
    """

    def __init__(self, allowed: int | None = None) -> None:
        self.allowed = allowed
        self.skipped: dict[str, tuple[str, int]] = {}

    def observe(self, batch: Batch, training: bool) -> None:
        """Counts what a batch on the host had to leave out."""
        self.skip(batch["skipped"])

    def skip(self, skipped: Mapping[str, tuple[str, int]]) -> None:
        """Notes recordings that could not be read.

        Args:
            skipped: Like the attribute.

        Raises:
            DataError: More is lost than `allowed`; lists it.
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
        """Keeps them, for the report of a resumed run."""
        checkpoint["skipped"] = dict(self.skipped)

    def on_load_checkpoint(
        self, trainer: L.Trainer, pl_module: L.LightningModule, checkpoint: dict[str, Any]
    ) -> None:
        """Goes on with them."""
        self.skipped = dict(checkpoint["skipped"])


class MetLabels(Callback):
    """Counts the labels that objectives meet in training.

    Args:
        module: Of the run.

    Attributes:
        labels: The counts.
    """

    def __init__(self, module: TouchModule) -> None:
        self.module = module
        self.labels = Labels()

    def observe(self, batch: Batch, training: bool) -> None:
        """Counts the labels of a batch on the host, for the objectives of this step."""
        for key, weight in (self.module.current_weights() if training else {}).items():
            if weight:
                needs: frozenset[str] = getattr(self.module.objectives[key], "needs", frozenset())
                self.labels.add(key, needs, batch)

    def on_train_end(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        """Names the objectives that met no label in a run too short to be warned in."""
        for key, count in self.labels.counts.items():
            if count["batches"] < PATIENCE and (line := self.labels.missing(key, has_ended=True)):
                log.warning(line)

    def on_save_checkpoint(
        self, trainer: L.Trainer, pl_module: L.LightningModule, checkpoint: dict[str, Any]
    ) -> None:
        """Keeps the counts, for the report of a resumed run."""
        checkpoint["labels"] = {key: dict(count) for key, count in self.labels.counts.items()}

    def on_load_checkpoint(
        self, trainer: L.Trainer, pl_module: L.LightningModule, checkpoint: dict[str, Any]
    ) -> None:
        """Goes on with the counts."""
        self.labels = Labels(checkpoint["labels"])
