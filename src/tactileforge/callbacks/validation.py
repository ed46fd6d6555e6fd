"""A validation at the end of every run."""

from __future__ import annotations

from typing import Any

import lightning as L
from lightning.pytorch.callbacks import Callback


class LastValidation(Callback):
    """Validates after the last step, however short the run and long the interval."""

    def on_train_batch_end(
        self,
        trainer: L.Trainer,
        pl_module: L.LightningModule,
        outputs: Any,
        batch: Any,
        batch_idx: int,
    ) -> None:
        """Asks for it: Lightning validates a run that is to stop."""
        if trainer.global_step >= trainer.estimated_stepping_batches:
            trainer.should_stop = True
            trainer.check_val_every_n_epoch = None  # whichever epoch this is
