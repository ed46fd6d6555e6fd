"""A validation at the end of every run."""

from __future__ import annotations

from typing import Any

import lightning as L
from lightning.pytorch.callbacks import Callback


class LastValidation(Callback):
    """Validates after the last step, for any length of run and any validation interval."""

    def on_train_batch_end(
        self,
        trainer: L.Trainer,
        pl_module: L.LightningModule,
        outputs: Any,
        batch: Any,
        batch_idx: int,
    ) -> None:
        """Requests a stop after the last step, since Lightning validates before it stops."""
        if trainer.global_step >= trainer.estimated_stepping_batches:
            trainer.should_stop = True
            trainer.check_val_every_n_epoch = None  # or Lightning may skip validation this epoch
