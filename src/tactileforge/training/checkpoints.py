"""Crash-safe checkpoints: written beside their place and renamed."""

from __future__ import annotations

import logging
import os
import shutil
import signal
import sys
from contextlib import ExitStack, suppress
from pathlib import Path
from types import FrameType
from typing import Any

import lightning as L
import torch
from lightning.pytorch.callbacks import Callback, ModelCheckpoint
from lightning.pytorch.plugins.io import TorchCheckpointIO

from tactileforge.errors import ConfigError, TactileForgeError, unknown
from tactileforge.runs.checkpoint_file import read_checkpoint, read_own, seal
from tactileforge.runs.folder import BEST, LAST
from tactileforge.training.module import log_interval
from tactileforge.util.bars import Bar
from tactileforge.util.files import new_part
from tactileforge.util.signals import handled

log = logging.getLogger(__name__)


class AtomicCheckpointIO(TorchCheckpointIO):
    """Writes to ``.part`` beside the file, then renames: a killed run keeps its last checkpoint.

    Args:
        run: Identity of the run, stored in its checkpoints; see `run_folder.identity`.
    """

    def __init__(self, run: str | None = None) -> None:
        self.run = run

    def save_checkpoint(
        self, checkpoint: dict[str, Any], path: str | Path, storage_options: Any = None
    ) -> None:
        """Saves a checkpoint.

        Raises:
            TactileForgeError: The disk is full or cannot be written; the last checkpoint stays.
        """
        path = Path(path)
        try:
            with new_part(path) as part:
                with part.open("w+b") as file:
                    torch.save({**checkpoint, "run": self.run}, file)
                    seal(file)
                    os.fsync(file.fileno())  # before the rename, so that a power cut leaves a file
                part.replace(path)
        except (OSError, RuntimeError) as error:  # torch turns a full disk into a RuntimeError
            raise TactileForgeError(
                f"{path}: the checkpoint cannot be written ({error}); the one before it stays. "
                "Make room, then go on with resume="
            ) from error

    def load_checkpoint(
        self, path: str | Path, map_location: Any = None, weights_only: bool | None = None
    ) -> dict[str, Any]:
        """Reads a checkpoint of this run; see `read_own`."""
        return read_own(path, self.run)


class Checkpoints(Callback):
    """Saves ``last.ckpt`` at regular steps, at the end, and on a signal to stop.

    The first Ctrl-C, SIGTERM or SIGHUP lets the step finish, saves and ends the run in order; the
    second ends it at once. Several processes agree on it only at the next logged or saved step,
    since this communication makes a step wait for the device.

    Args:
        folder: Folder of the run.
        every: Number of steps between two saves.

    Attributes:
        interrupted: Whether this process was asked to stop; after the run, whether it was stopped.
        started: Whether training began, after a checkpoint to resume from was read successfully.
    """

    def __init__(self, folder: Path, every: int) -> None:
        self.path = folder / LAST
        self.every = every
        self.interrupted = self._stopped = self.started = False
        self._listening = ExitStack()
        #: Step of the last save of this process, and of its start.
        self._saved, self._first = -1, 0

    def on_train_start(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        """Checks room on the disk and listens for signals.

        Raises:
            TactileForgeError: There is no room for the first checkpoint.
        """
        if trainer.is_global_zero:
            check_room(self.path, _size(trainer))
        self.started = True
        self._first = trainer.global_step
        self._listening.enter_context(handled(self._stop))

    def on_train_batch_start(
        self, trainer: L.Trainer, pl_module: L.LightningModule, batch: Any, batch_idx: int
    ) -> None:
        """Checks room on the disk before a step with a save, since a failed save loses the step.

        Raises:
            TactileForgeError: There is not enough room; the last checkpoint stays.
        """
        if trainer.is_global_zero and (trainer.global_step + 1) % self.every == 0:
            check_room(self.path, _size(trainer))

    def _stop(self, number: int, frame: FrameType | None) -> None:
        if self.interrupted:
            raise KeyboardInterrupt(f"stopped at once by {signal.Signals(number).name}")
        self.interrupted = True
        with suppress(OSError):  # the terminal may be gone
            Bar.write("stopping after this step (once more to stop at once)")
            sys.stdout.flush()

    def on_train_batch_end(
        self,
        trainer: L.Trainer,
        pl_module: L.LightningModule,
        outputs: Any,
        batch: Any,
        batch_idx: int,
    ) -> None:
        """Saves every ``every`` steps, and when the run is asked to stop."""
        # between the batches of a step there is nothing whole to save
        if (trainer.fit_loop.total_batch_idx + 1) % trainer.accumulate_grad_batches:
            return
        due = trainer.global_step % self.every == 0
        stop = self._is_asked(trainer, due)
        if stop or due:
            self._save(trainer)
        if stop:
            self._stopped = trainer.should_stop = True

    def _is_asked(self, trainer: L.Trainer, due: bool) -> bool:
        """Whether any process was asked to stop, as agreed by all processes."""
        if trainer.world_size == 1:
            return self.interrupted
        # processes meet in logged and saved steps anyway: a message in each step would cost time
        if not due and trainer.global_step % log_interval(trainer):
            return False
        return trainer.strategy.reduce_boolean_decision(self.interrupted, all=False)

    def on_train_end(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        """Saves at the end of the run, and stops listening."""
        if not self._stopped:
            self._save(trainer)
        self.interrupted = self._stopped  # a signal after the last step stopped nothing
        self._release()

    def on_exception(
        self, trainer: L.Trainer, pl_module: L.LightningModule, exception: BaseException
    ) -> None:
        """Saves what was trained before an error, as that of a user's callback; stops listening."""
        self._release()
        stopped = isinstance(exception, KeyboardInterrupt | TactileForgeError)
        is_news = self.started and trainer.global_step > max(self._saved, self._first)
        if stopped or not is_news or trainer.world_size > 1:
            return
        with suppress(Exception):  # the error of the run is the one to show
            self._save(trainer)
            log.error("the run was saved at step %d, before the error below", trainer.global_step)

    def _save(self, trainer: L.Trainer) -> None:
        trainer.save_checkpoint(self.path)
        self._saved = trainer.global_step

    def _release(self) -> None:
        self._listening.close()


class _Best(ModelCheckpoint):
    """Keeps the best weights; ignores validations without its metric.

    The metric is absent while its objective has weight 0 or sees no label.
    """

    def load_state_dict(self, state_dict: dict[str, Any]) -> None:
        """Restores the best score from the file of the best weights, if there is one.

        That file may be newer than the run's last checkpoint, for a run stopped after a validation,
        and the folder of the run may have moved.
        """
        path = Path(str(self.dirpath)) / BEST.name
        score = read_checkpoint(path)["scores"].get(self.monitor) if path.is_file() else None
        if score is not None:
            best, name = torch.tensor(score), str(path)
            known = {"best_model_score": best, "best_model_path": name, "kth_value": best}
            known |= {"kth_best_model_path": name, "best_k_models": {name: best}}
            super().load_state_dict({**state_dict, **known, "dirpath": self.dirpath})

    def on_validation_end(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        """Keeps the weights if they are the best so far.

        Raises:
            ConfigError: The objective was validated, and the metric is none of its parts.
        """
        logged, name = trainer.callback_metrics, str(self.monitor)
        score = logged.get(name)
        if score is None and name.rpartition("/")[0] in logged:
            known = [key for key in logged if key.startswith("val/")]
            raise ConfigError(unknown("trainer.keep_best", name, known))
        if score is not None and bool(torch.isfinite(score)):
            super().on_validation_end(trainer, pl_module)

    def on_train_end(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        """Warns if the metric was never validated."""
        super().on_train_end(trainer, pl_module)
        if not self.best_model_path:
            log.warning(
                "trainer.keep_best=%s: never validated, so no best weights are kept; at the end "
                "there were %s",
                self.monitor,
                ", ".join(sorted(k for k in trainer.callback_metrics if k.startswith("val/")))
                or "none",
            )


def best_checkpoint(folder: Path, metric: str | None) -> list[Callback]:
    """Builds a callback to keep the weights with the best value of a metric in `BEST`.

    Args:
        folder: Folder of the run.
        metric: Name of the metric, such as ``val/denoise``; None keeps none. Larger is better for
            accuracy and R2, smaller for all others.
    """
    if metric is None:
        return []
    keeper = _Best(
        dirpath=folder / BEST.parent,
        filename=BEST.stem,
        monitor=metric,
        mode="max" if metric.rpartition("/")[2].startswith(("accuracy", "r2")) else "min",
        save_weights_only=True,
        # a resumed run replaces its file: Lightning would write best-v1.ckpt beside it
        enable_version_counter=False,
        save_on_train_epoch_end=False,
    )
    return [keeper]


def check_room(path: Path, size: int) -> None:
    """Checks the room for a checkpoint of ``size`` bytes beside the previous one.

    Raises:
        TactileForgeError: The disk has less room.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    free = shutil.disk_usage(path.parent).free
    if free < size:
        fix = "Make room, or give another hydra.run.dir="
        if path.exists():
            fix = "The one before it stays: make room, then go on with resume="
        raise TactileForgeError(
            f"{path}: the disk is full: {free / 1e6:,.1f} MB are left, and a checkpoint takes "
            f"{size / 1e6:,.1f} MB. {fix}"
        )


def _size(trainer: L.Trainer) -> int:
    """Estimates the size of the next checkpoint, bytes: weights and state of the optimiser."""
    # state_dict() of sharded weights is a collective call, and only one process runs this function
    module = trainer.lightning_module
    state = [*module.parameters(), *module.buffers()]
    kept = [x for optim in trainer.optimizers for one in optim.state.values() for x in one.values()]
    if not kept:  # before the first step: as AdamW, with two averages of each parameter
        kept = 2 * [x for x in module.parameters() if x.requires_grad]
    return sum(x.nbytes for x in [*state, *kept] if isinstance(x, torch.Tensor))
