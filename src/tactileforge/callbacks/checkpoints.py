"""Checkpoints that survive: written beside and renamed, read without executing anything."""

from __future__ import annotations

import os
import signal
from collections.abc import Mapping
from pathlib import Path
from types import FrameType
from typing import Any

import lightning as L
import torch
from lightning.pytorch.callbacks import Callback
from lightning.pytorch.plugins.io import TorchCheckpointIO
from torch import nn

from tactileforge.errors import ConfigError, DataNotFoundError

#: Where a run keeps the checkpoint that it resumes from.
LAST = Path("checkpoints") / "last.ckpt"


class AtomicCheckpointIO(TorchCheckpointIO):
    """Writes to ``.part`` beside the file, then renames: a killed run keeps its last checkpoint."""

    def save_checkpoint(
        self, checkpoint: dict[str, Any], path: str | Path, storage_options: Any = None
    ) -> None:
        """Saves; see the class."""
        path = Path(path)
        path.parent.mkdir(parents=True, exist_ok=True)
        part = path.with_name(path.name + ".part")
        with part.open("wb") as file:
            torch.save(checkpoint, file)
            file.flush()
            os.fsync(file.fileno())
        part.replace(path)


class Checkpoints(Callback):
    """Saves ``last.ckpt`` every so many steps, at the end, and when the run is asked to stop.

    The first Ctrl-C (or SIGTERM) lets the step finish, saves and ends the run in order; the second
    ends it at once.

    Args:
        folder: Folder of the run.
        every: Steps between two saves.
    """

    def __init__(self, folder: Path, every: int) -> None:
        self.path = folder / LAST
        self.every = every
        self.interrupted = False
        self._handlers: dict[int, Any] = {}

    def on_train_start(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        """Listens for signals."""
        for number in (signal.SIGINT, signal.SIGTERM):
            self._handlers[number] = signal.signal(number, self._stop)

    def _stop(self, number: int, frame: FrameType | None) -> None:
        self.interrupted = True
        signal.signal(number, self._handlers[number])
        print("\nstopping after this step (once more to stop at once)", flush=True)

    def on_train_batch_end(
        self,
        trainer: L.Trainer,
        pl_module: L.LightningModule,
        outputs: Any,
        batch: Any,
        batch_idx: int,
    ) -> None:
        """Saves when it is time."""
        stepped = (trainer.fit_loop.total_batch_idx + 1) % trainer.accumulate_grad_batches == 0
        stop = trainer.strategy.reduce_boolean_decision(self.interrupted, all=False)
        if stepped and (stop or trainer.global_step % self.every == 0):
            trainer.save_checkpoint(self.path)
        if stepped and stop:
            self.interrupted = trainer.should_stop = True

    def on_train_end(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        """Saves the end of the run, and stops listening."""
        if not self.interrupted:
            trainer.save_checkpoint(self.path)
        self._release()

    def on_exception(
        self, trainer: L.Trainer, pl_module: L.LightningModule, exception: BaseException
    ) -> None:
        """Stops listening."""
        self._release()

    def _release(self) -> None:
        for number, handler in self._handlers.items():
            signal.signal(number, handler)
        self._handlers.clear()


def find_checkpoint(path: str | Path) -> Path:
    """The checkpoint of a run folder, or the file itself.

    Raises:
        DataNotFoundError: There is none; says what to give.
    """
    path = Path(path)
    file = path / LAST if path.is_dir() else path
    if not file.is_file():
        raise DataNotFoundError(f"no checkpoint at {file}; give the folder of a run, or its file")
    return file


def read_checkpoint(path: str | Path) -> dict[str, Any]:
    """Reads a checkpoint on the CPU; tensors and plain data only, no code.

    Raises:
        DataNotFoundError: See `find_checkpoint`.
        ConfigError: The file is not a checkpoint.
    """
    file = find_checkpoint(path)
    try:
        checkpoint: dict[str, Any] = torch.load(
            file, map_location="cpu", weights_only=True, mmap=True
        )
    except Exception as error:
        raise ConfigError(f"{file} is not a checkpoint that can be read: {error}") from error
    return checkpoint


def initialise(module: nn.Module, state: Mapping[str, torch.Tensor]) -> str:
    """Starts a module from the weights of another run; everything of the encoder must fit.

    Heads and objectives are taken where name and shape agree, because the new run may have others;
    how they were balanced is not.

    Returns:
        A line that says what was taken and what was not.

    Raises:
        ConfigError: Encoder tensors are missing, left over, or of another shape; names them.
    """
    current, state = (
        {key: value for key, value in states.items() if not key.startswith("balance.")}
        for states in (module.state_dict(), state)
    )
    fits = {k: v for k, v in state.items() if k in current and current[k].shape == v.shape}
    wrong = [
        f"{key} ({tuple(state[key].shape) if key in state else 'missing'} in the checkpoint, "
        f"{tuple(current[key].shape) if key in current else 'absent'} here)"
        for key in sorted(current.keys() | state.keys())
        if key.startswith("encoder.") and key not in fits
    ]
    if wrong:
        some = "; ".join(wrong[:5])
        raise ConfigError(f"init: the encoder does not fit: {some} ({len(wrong)} in all)")
    module.load_state_dict(fits, strict=False)
    fresh = sorted({key.rsplit(".", 1)[0] for key in current.keys() - fits.keys()})
    left = sorted({key.rsplit(".", 1)[0] for key in state.keys() - fits.keys()})
    return f"init: {len(fits)} tensors taken; new: {fresh or 'none'}; not used: {left or 'none'}"
