"""One progress bar for the whole run."""

from __future__ import annotations

from typing import Any

import lightning as L
from lightning.pytorch.callbacks import Callback

from tactileforge.training.module import log_interval
from tactileforge.util.bars import Bar


class Progress(Callback):
    """Progress bar with steps, remaining time, the losses of the active objectives, and the speed.

    Losses are those logged last, so no step waits for the device.
    """

    def __init__(self) -> None:
        self.bar: Bar | None = None

    def on_train_start(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        """Draws the bar, starting at the current step of a resumed run."""
        if trainer.is_global_zero:
            total = int(trainer.estimated_stepping_batches)
            self.bar = Bar(total=total, initial=trainer.global_step, desc="train", unit="step")

    def on_train_batch_end(
        self,
        trainer: L.Trainer,
        pl_module: L.LightningModule,
        outputs: Any,
        batch: Any,
        batch_idx: int,
    ) -> None:
        """Advances the bar."""
        if self.bar is None:
            return
        if trainer.global_step % log_interval(trainer) == 0:
            losses = {
                name.removeprefix("train/"): f"{float(value):.3g}"
                for name, value in trainer.logged_metrics.items()
                if name.startswith("train/") and name.count("/") == 1
            }
            absent = dict.fromkeys(getattr(pl_module, "unlabelled", ()), "no label")
            self.bar.set_postfix(losses | absent | _speed(trainer), refresh=False)
        # not by one: a step may have several batches
        self.bar.update(trainer.global_step - self.bar.n)

    def on_train_end(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        """Closes the bar."""
        self._close()

    def on_exception(
        self, trainer: L.Trainer, pl_module: L.LightningModule, exception: BaseException
    ) -> None:
        """Closes the bar, so the error starts on a new line."""
        self._close()

    def _close(self) -> None:
        if self.bar is not None:
            self.bar.close()


def _speed(trainer: L.Trainer) -> dict[str, str]:
    """Speed as last logged; see `speed.Speed`."""
    logged = trainer.logged_metrics
    shown = {}
    if "speed/clips_per_s" in logged:
        shown["clips/s"] = f"{float(logged['speed/clips_per_s']):.3g}"
        shown["waiting"] = f"{float(logged['speed/waiting']):.0%}"
    if "speed/mfu" in logged:
        shown["MFU"] = f"{float(logged['speed/mfu']):.0%}"
    return shown
